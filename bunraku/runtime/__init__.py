"""How the nodes live: topics, steps, parameters, clock, journal, launch and bag. No numpy maths here."""

"""The course game: tiles to walk along, obstacles that move, and what they cost (Oshita 2005, section 7.2)."""

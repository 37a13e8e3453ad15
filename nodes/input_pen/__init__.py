"""Pens: where one is, how hard it presses and how it leans, from any of several drivers, as `pen` messages."""

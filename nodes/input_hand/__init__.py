"""Hands in the air: bends and places of both, from any of several drivers, as `hands` messages."""

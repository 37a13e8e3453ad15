"""Gamepads: the page, the kernel or a written performance becomes `pad`."""

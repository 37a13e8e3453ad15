"""Touch surfaces: what fingers did, from any of several drivers, as one `touch` message per device and frame."""

"""What was meant: touches, pens, hands and walking fingers become targets, commands and the camera."""

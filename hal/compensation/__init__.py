"""Adjust the goals of servos to compensate for gravity, compliance and backlash."""

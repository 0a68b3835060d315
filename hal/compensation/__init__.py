"""Compensation of gravity, compliance and backlash in the goals of servos."""

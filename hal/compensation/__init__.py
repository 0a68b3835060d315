"""Gravity, compliance and backlash of soft servos, made up for in their goals."""

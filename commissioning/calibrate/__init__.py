"""Calibrate an arm: find the sign, the zero and the homing offset of each joint."""

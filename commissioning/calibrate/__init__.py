"""Calibration: how the servos' counts become joint positions of the URDF."""

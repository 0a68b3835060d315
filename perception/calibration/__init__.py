"""Calibrate a camera's intrinsics and its pose above the table with a ChArUco board."""

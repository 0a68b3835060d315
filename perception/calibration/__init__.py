"""Calibrate a camera with a ChArUco board: its intrinsics, and its pose above the table."""

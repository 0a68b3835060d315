"""Calibrate the intrinsics of a camera, and its pose above the table, with a ChArUco board."""

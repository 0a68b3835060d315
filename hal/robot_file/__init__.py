"""Robot file and calibration file, which assign a servo to each joint."""

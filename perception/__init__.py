"""See with a camera: camera sources, calibration, and grading of apples. This package does not use ROS."""

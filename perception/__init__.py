"""Camera sources, camera calibration and grading of apples. This package does not use ROS."""

"""Camera sources, camera calibration and apple grading. This package does not use ROS."""

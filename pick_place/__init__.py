"""Pick-and-place job: its steps, settings and state, without ROS."""

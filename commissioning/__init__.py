"""Set up, calibrate, tune and diagnose an arm. The command-line tools use these functions; they do not need ROS."""

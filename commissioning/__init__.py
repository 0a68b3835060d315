"""Set up, calibrate, tune and diagnose an arm. The command-line tools use these functions, which do not need ROS."""

"""Run the whole stack without ROS in simulated time, for users' tests and for ``servoloop simulate``."""

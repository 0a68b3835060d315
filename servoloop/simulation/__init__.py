"""Run the whole stack without ROS in simulated time, for tests of users and for ``servoloop simulate``."""

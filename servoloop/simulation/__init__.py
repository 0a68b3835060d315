"""Run the whole stack below ROS in simulated time, for tests of users and for ``servoloop simulate``."""

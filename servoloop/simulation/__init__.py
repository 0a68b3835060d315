"""The whole stack below ROS on simulated time: what users' tests and ``servoloop simulate`` run."""

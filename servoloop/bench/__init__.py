"""``servoloop bench``: measure the bus, the control loop, the ROS interface and the motion of an arm."""

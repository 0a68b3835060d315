"""The fixed-rate control loop, the controllers and motion planning. This package does not use I/O, ROS or the wall
clock."""

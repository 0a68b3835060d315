"""The fixed-rate loop, the controllers and the motion planning. This package has no I/O, no ROS and no wall clock."""

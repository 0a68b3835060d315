"""The fixed-rate loop, the controllers, ruckig. No I/O, no ROS, no wall clock."""

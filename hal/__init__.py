"""Hardware layer: joints in SI units with life cycle, calibration, limits and safety gate. Does not depend on ROS."""

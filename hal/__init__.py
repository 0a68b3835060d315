"""Hardware layer: joints in SI units with life cycle, calibration, limits and a safety gate. This layer does not depend
on ROS."""

"""Joints in SI units: the hardware life cycle, calibration, limits, the safety gate. No bytes, no ROS."""

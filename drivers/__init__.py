"""Bytes and registers: the port, the protocols, the servo models, the bus. No radians, no threads, no ROS."""

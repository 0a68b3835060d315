"""Servo drivers: ports, protocols, servo models and buses, all in bytes and registers, without threads or ROS."""

"""Servo drivers: ports, protocols, servo models and buses. They handle only bytes and registers, without threads or
ROS."""

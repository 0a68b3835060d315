"""Conversions between MoveIt's messages and objects of planning/. No function in this package communicates over ROS."""

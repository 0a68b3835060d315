"""Motion planning: search, collision checks and timing.

This package does not use ROS, and has no threads and no clock of its own.
"""

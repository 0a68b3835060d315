"""Motion planning: path search, collision checks and timing.

This package does not use ROS, and it does not create threads or have its own clock.
"""

"""Load, configure and switch the controllers of one robot, like the controller manager of ros2_control."""

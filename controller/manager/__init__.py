"""Load, configure and switch the controllers of one robot, as the controller manager of ros2_control does."""

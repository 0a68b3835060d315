"""Load, configure and switch the controllers of one robot, as ros2_control's controller manager does."""

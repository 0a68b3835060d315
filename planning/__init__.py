"""Motion planning: search, collision checks and timing. This package has no ROS, no threads and no clock of its own."""

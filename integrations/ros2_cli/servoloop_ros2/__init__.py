"""The ``ros2`` command for environments without ros2cli."""

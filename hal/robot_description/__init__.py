"""URDF parser: joints, links, masses and ``<ros2_control>`` blocks."""

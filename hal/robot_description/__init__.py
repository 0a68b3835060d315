"""The URDF: joints, links, masses, and ros2_control's hardware blocks."""

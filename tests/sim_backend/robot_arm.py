"""Joints and ready pose with the hand open (rad, m), as in urdf/scene.xml."""

from typing import Final

JOINTS: Final = (*(f"joint{i}" for i in range(1, 7)), "hand_right_joint")
READY: Final = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828, 0.0)

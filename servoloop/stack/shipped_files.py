"""Paths of the files that come with servoloop."""

from pathlib import Path
from typing import Final

HOME: Final = Path(__file__).resolve().parents[2]
CONFIG: Final = HOME / "config"
URDF: Final = HOME / "urdf" / "robot_arm.urdf"
CONTROLLERS: Final = CONFIG / "arm_controllers.yaml"
SCENE: Final = HOME / "urdf" / "scene.xml"
ARMS: Final = CONFIG / "arms"
ARM_FILE: Final = "arm.yaml"
"""Name of the file that describes an arm in its folder."""
OWN: Final = "robot_arm"
"""Default arm."""

"""LeRobot teleoperator of type ``servoloop``."""

from lerobot_teleoperator_servoloop.config import ServoloopTeleoperatorConfig
from lerobot_teleoperator_servoloop.teleoperator import ServoloopTeleoperator

__all__ = ["ServoloopTeleoperator", "ServoloopTeleoperatorConfig"]

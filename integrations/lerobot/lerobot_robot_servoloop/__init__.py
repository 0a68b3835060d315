"""LeRobot robot of type ``servoloop``. LeRobot imports this package by its name, so it registers both types."""

from lerobot_robot_servoloop.config import ServoloopRobotConfig
from lerobot_robot_servoloop.robot import ServoloopRobot
from lerobot_teleoperator_servoloop import ServoloopTeleoperator, ServoloopTeleoperatorConfig

__all__ = ["ServoloopRobot", "ServoloopRobotConfig", "ServoloopTeleoperator", "ServoloopTeleoperatorConfig"]

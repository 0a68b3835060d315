"""LeRobot robot of type ``servoloop``. LeRobot imports this package by its name, so the package registers both the
robot and the teleoperator."""

from lerobot_robot_servoloop.config import ServoloopRobotConfig
from lerobot_robot_servoloop.robot import ServoloopRobot
from lerobot_teleoperator_servoloop import ServoloopTeleoperator, ServoloopTeleoperatorConfig

__all__ = ["ServoloopRobot", "ServoloopRobotConfig", "ServoloopTeleoperator", "ServoloopTeleoperatorConfig"]

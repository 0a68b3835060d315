"""Use the robot class of the plugin, and kill its stack. This script runs in the environment of LeRobot.

The argument is the process ID of the stack.
"""

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from lerobot.cameras import CameraConfig
from lerobot.robots import make_robot_from_config
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from lerobot_robot_servoloop import ServoloopRobotConfig


@CameraConfig.register_subclass("black")
@dataclass
class BlackCameraConfig(CameraConfig):
    """Options of the camera. The camera has only the options that every camera has."""


class BlackCamera:
    """Camera whose images are black."""

    def __init__(self, config: Any) -> None:
        self.width, self.height = config.width, config.height
        self.is_connected = False

    def connect(self) -> None:
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def read_latest(self) -> Any:
        return np.zeros((self.height, self.width, 3), np.uint8)


camera = BlackCameraConfig(width=6, height=4, fps=30)
robot: Any = make_robot_from_config(ServoloopRobotConfig(max_relative_target=5.0, cameras={"front": camera}))


def show_error(kind: type[Exception], call: Callable[[], object]) -> bool:
    """Print the error that a call raises, and return whether the call has raised an error."""
    try:
        call()
    except kind as error:
        print(type(error).__name__, error)
        return True
    return False


show_error(DeviceNotConnectedError, robot.get_observation)
robot.connect()
show_error(DeviceAlreadyConnectedError, robot.connect)
observation = robot.get_observation()
assert observation.keys() == robot.observation_features.keys()
print("image", observation.pop("front").shape)
before = observation["shoulder_pan.pos"]
print(
    f"moved by {robot.send_action({**observation, 'shoulder_pan.pos': before + 50.0})['shoulder_pan.pos'] - before:.0f}"
)
show_error(ConnectionError, lambda: robot.send_action({"gripper.pos": float("nan")}))
os.kill(int(sys.argv[1]), signal.SIGKILL)
while not show_error(DeviceNotConnectedError, lambda: robot.send_action(observation)):
    pass
robot.disconnect()
assert not robot.is_connected and not robot.cameras["front"].is_connected

"""LeRobot robot whose arm a running servoloop stack moves."""

from functools import cached_property
from typing import Any

from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.robots.utils import ensure_safe_goal_position
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_servoloop.config import ServoloopRobotConfig
from lerobot_servoloop.arm import ArmChoice, ConnectedArm
from lerobot_servoloop.device_errors import connected, connecting

Features = dict[str, Any]


class ServoloopRobot(Robot):
    """Arm of a running ``servoloop up``, with LeRobot's cameras.

    The features are named as in LeRobot's SO-101, such as ``shoulder_pan.pos``. servoloop calibrates the arm.
    """

    config_class = ServoloopRobotConfig
    name = "servoloop"

    def __init__(self, config: ServoloopRobotConfig) -> None:
        """Create a robot that is not connected."""
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._arm: ConnectedArm | None = None

    @cached_property
    def observation_features(self) -> Features:
        """Names and types of the values in an observation."""
        cameras: Features = {}
        for name, camera in self.cameras.items():
            if getattr(camera, "use_rgb", True):
                cameras[name] = (camera.height, camera.width, 3)
            if getattr(camera, "use_depth", False):
                cameras[f"{name}_depth"] = (camera.height, camera.width, 1)
        return {**self.action_features, **cameras}

    @cached_property
    def action_features(self) -> Features:
        """Names and types of the values in an action."""
        return {f"{joint}.pos": float for joint in self.config.joints}

    @property
    def is_connected(self) -> bool:
        """Whether the robot is connected. A robot whose connection was lost counts as connected until ``disconnect`` is
        called."""
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        """Always True, because servoloop stores the calibration of the arm."""
        return True

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connect to the stack, take control of the motion and enable the torque. The arm holds its position.

        Args:
            calibrate: Ignored, because servoloop stores the calibration of the arm.

        Raises:
            DeviceNotConnectedError: No stack matches, or another client has control of the arm.
        """
        config = self.config
        with connecting():
            choice = ArmChoice(config.arm, config.joints, config.use_degrees, config.namespace)
            self._arm = ConnectedArm(choice, "LeRobot, robot")
            try:
                self._arm.take(config.max_age_s)
                for camera in self.cameras.values():
                    camera.connect()
            except BaseException:
                self.disconnect()
                raise

    def calibrate(self) -> None:
        """Do nothing, because ``servoloop calibrate`` calibrates the arm."""

    def configure(self) -> None:
        """Do nothing, because servoloop's robot file contains the settings of the servos."""

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Return the measured positions and the latest images.

        Raises:
            DeviceNotConnectedError: The connection is lost.
            StackError: A joint has no measured position.
        """
        observation: dict[str, Any] = _features(self._positions())
        for name, camera in self.cameras.items():
            if getattr(camera, "use_rgb", True):
                observation[name] = camera.read_latest()
            if getattr(camera, "use_depth", False):
                observation[f"{name}_depth"] = camera.read_latest_depth()
        return observation

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Move toward the target positions, and return the positions that were sent, clipped to the limits of the
        joints.

        Raises:
            DeviceNotConnectedError: The connection is lost.
            StackError: A joint or a value is invalid, or another client has taken control of the motion.
        """
        values = {key.removesuffix(".pos"): float(value) for key, value in action.items() if key.endswith(".pos")}
        if self.config.max_relative_target is not None:
            measured = self._positions()
            pairs = {joint: (value, measured.get(joint, value)) for joint, value in values.items()}
            values = ensure_safe_goal_position(pairs, self.config.max_relative_target)
        assert self._arm is not None
        with connected():
            return _features(self._arm.send(values))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Disconnect from the stack and the cameras. The arm holds its position."""
        if self._arm is not None:
            self._arm.close()
            self._arm = None
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _positions(self) -> dict[str, float]:
        assert self._arm is not None
        with connected():
            return self._arm.positions()


def _features(values: dict[str, float]) -> dict[str, Any]:
    return {f"{joint}.pos": value for joint, value in values.items()}

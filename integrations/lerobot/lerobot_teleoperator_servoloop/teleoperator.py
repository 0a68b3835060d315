"""LeRobot teleoperator that reads a leader arm from a running servoloop stack."""

from functools import cached_property
from typing import Any

from lerobot.teleoperators import Teleoperator
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_servoloop.arm import ArmChoice, ConnectedArm
from lerobot_servoloop.device_errors import connected, connecting
from lerobot_teleoperator_servoloop.config import ServoloopTeleoperatorConfig


class ServoloopTeleoperator(Teleoperator):
    """Leader arm of a running ``servoloop up``. The measured positions of the arm are the action."""

    config_class = ServoloopTeleoperatorConfig
    name = "servoloop"

    def __init__(self, config: ServoloopTeleoperatorConfig) -> None:
        """Create a teleoperator that is not connected."""
        super().__init__(config)
        self.config = config
        self._arm: ConnectedArm | None = None

    @cached_property
    def action_features(self) -> dict[str, Any]:
        """Names and types of the values in an action."""
        return {f"{joint}.pos": float for joint in self.config.joints}

    @property
    def feedback_features(self) -> dict[str, Any]:
        """Always empty, because the leader does not accept feedback."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether the leader is connected. A leader whose connection was lost counts as connected until ``disconnect``
        is called."""
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        """Always True, because servoloop stores the calibration of the arm."""
        return True

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connect to the stack and release the leader's torque, unless the options specify otherwise.

        Args:
            calibrate: Ignored, because servoloop stores the calibration of the arm.

        Raises:
            DeviceNotConnectedError: No stack matches, or the torque cannot be released.
        """
        config = self.config
        with connecting():
            choice = ArmChoice(config.arm, config.joints, config.use_degrees, config.namespace)
            self._arm = ConnectedArm(choice, "LeRobot, leader")
            try:
                if config.release_torque:
                    self._arm.release_torque()
            except BaseException:
                self.disconnect()
                raise

    def calibrate(self) -> None:
        """Do nothing, because ``servoloop calibrate`` calibrates the arm."""

    def configure(self) -> None:
        """Do nothing, because servoloop's robot file contains the settings of the servos."""

    @check_if_not_connected
    def get_action(self) -> dict[str, Any]:
        """Return the measured positions.

        Raises:
            DeviceNotConnectedError: The connection is lost.
            StackError: A joint has no measured position.
        """
        assert self._arm is not None
        with connected():
            return {f"{joint}.pos": value for joint, value in self._arm.positions().items()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Raise NotImplementedError, because the leader does not accept feedback."""
        raise NotImplementedError("a servoloop leader does not accept feedback")

    @check_if_not_connected
    def disconnect(self) -> None:
        """Disconnect from the stack. The torque of the leader is not changed."""
        if self._arm is not None:
            self._arm.close()
            self._arm = None

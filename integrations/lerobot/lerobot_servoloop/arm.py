"""Read and move the arm of a running stack in the units of LeRobot."""

import logging
import math
from collections.abc import Mapping
from time import monotonic
from typing import Final, NamedTuple

from lerobot_servoloop.connection import StackError, find_stack_connection
from lerobot_servoloop.units import joint_scales

LOG = logging.getLogger(__name__)

SO_JOINTS: Final = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
"""Joint names of the SO-100 and the SO-101."""
MAX_MEASUREMENT_AGE_S: Final = 1.0
"""Maximum age of a measurement, in seconds."""
TORQUE_S: Final = 90.0
"""Maximum time to enable the torque, or to move to the park pose and release it, in seconds."""


class ArmChoice(NamedTuple):
    """Arm to connect to, and the units of its values."""

    arm: str | None
    """Name of the arm, its folder, or the process ID of the stack. None selects the only running stack."""
    joints: list[str]
    """Joints that LeRobot reads and moves."""
    use_degrees: bool
    """Whether values are in degrees instead of -100 to 100."""
    namespace: str | None = None
    """ROS namespace of the stack; empty for the root namespace. None selects any namespace."""


class ConnectedArm:
    """Arm of a running stack. Values are in degrees or from -100 to 100, and from 0 to 100 for the gripper.

    All methods raise StackError if they fail. The object must be used in one thread only.
    """

    def __init__(self, choice: ArmChoice, name: str) -> None:
        """Connect to the stack. Nothing moves.

        Args:
            choice: Arm and units.
            name: Name of this program, for messages to other clients.

        Raises:
            StackError: No stack matches, the stack does not accept this client, or a joint does not exist.
        """
        self._stack = find_stack_connection(choice.arm, choice.namespace, name)
        try:
            self._scales = joint_scales(self._stack.request("arm"), choice.joints, choice.use_degrees)
        except StackError:
            self._stack.close()
            raise
        self._faults: dict[str, str] = {}
        self._max_age_s = 0.0
        self._sent_s = -math.inf
        """Time of the latest targets, in seconds."""

    @property
    def label(self) -> str:
        """Description of the arm for messages."""
        return self._stack.label

    def take(self, max_age_s: float) -> None:
        """Take control of the motion and enable the torque at the measured positions, so that ``send`` moves the arm.

        Args:
            max_age_s: Time without new targets after which the arm holds its position, in seconds.
        """
        self._stack.request("take")
        self._stack.request("torque", TORQUE_S, on=True)
        self._max_age_s = max_age_s
        self._stack.request("stream", max_age_s=max_age_s)

    def release_torque(self) -> None:
        """Move to the arm's park pose, if the arm has one, and release the torque of all servos."""
        self._stack.request("take")
        self._stack.request("torque", TORQUE_S, on=False)
        self._stack.request("release")

    def positions(self) -> dict[str, float]:
        """Return the measured position of each joint, in LeRobot's units. Faults that are new since the last call are
        logged."""
        state = self._stack.request("state")
        if state["age_s"] > MAX_MEASUREMENT_AGE_S:
            text = f"the latest measurement of {self.label} is {state['age_s']:.1f} s old: check the log of its stack"
            raise StackError("timeout", text)
        for joint, fault in state["faults"].items():
            if self._faults.get(joint) != fault:
                LOG.warning("%s: %s", self.label, fault)
        self._faults = dict(state["faults"])
        positions = state["position"]
        if silent := [joint for joint in self._scales if positions[joint] is None]:
            raise StackError("failed", f"{silent[0]} of {self.label} has no measured position: check its servo")
        return {joint: scale.value(positions[joint]) for joint, scale in self._scales.items()}

    def send(self, values: Mapping[str, float]) -> dict[str, float]:
        """Send targets in LeRobot's units, keyed by joint name. Return the sent values, which are clipped to the limits
        of the joints."""
        targets = {joint: self._target(joint, value) for joint, value in values.items()}
        try:
            self._stack.send_targets(targets)
        except StackError as error:
            # LeRobot sends no actions between two episodes. A stream that ended for a different reason stays closed.
            if error.kind != "stream_ended" or monotonic() - self._sent_s < 0.5 * self._max_age_s:
                raise
            self._stack.request("stream", max_age_s=self._max_age_s)
            self._stack.send_targets(targets)
        self._sent_s = monotonic()
        return {joint: self._scales[joint].value(target) for joint, target in targets.items()}

    def close(self) -> None:
        """Disconnect. The arm slows down within its limits and holds its position."""
        self._stack.close()

    def _target(self, joint: str, value: float) -> float:
        if joint not in self._scales:
            names = ", ".join(self._scales)
            raise StackError(
                "unknown", f"the action has the unknown joint {joint!r}: the joints of this robot are {names}"
            )
        if not math.isfinite(value):
            raise StackError("input", f"the action for {joint} is {value}: send a finite number")
        return self._scales[joint].position(float(value))

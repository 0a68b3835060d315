"""Freedrive for a local stack: a person moves the joints by hand, and the servos carry most of the weight."""

import logging
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import Final

from controller.teach.freedrive_controller import FreedriveController, guided_joint
from drivers.driver_errors import DriverError
from hal.components.component import Component
from hal.joint import Joint
from hal.servos.soft_torque import Softening, SoftTorque
from hal.types import JointFault
from servoloop.api.arm_errors import ArmBusyError, ArmError
from servoloop.api.stream_gate import InLoop, Takeover
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.robot_files import Files

LOG = logging.getLogger("servoloop")
FREEDRIVE: Final = "freedrive_controller"
"""Name of the controller that lets a person move the joints."""
HELD_CYCLES: Final = 4
"""Number of cycles with constant commands before the previous controllers resume. Without these cycles, the controllers
would continue the hand-guided motion."""
RETRY_S: Final = 1.0
"""Time between two attempts to restore torque limits, in seconds."""


class Freedrive:
    """Freedrive of one stack. Any thread may call ``begin`` and ``end``. The loop calls ``update`` after each cycle.

    When freedrive ends, each joint first holds its measured position. The torque limits are then restored, and the
    previous controllers become active again. If a servo does not respond, its torque limit is restored once it
    responds.
    """

    def __init__(self, stack: ControlStack, joints: Sequence[str], in_loop: InLoop) -> None:
        """``joints`` contains all joints that can be moved. ``in_loop`` runs an action between two cycles."""
        self._stack, self._joints, self._in_loop = stack, tuple(joints), in_loop
        self._takeover = Takeover(stack, FREEDRIVE)
        self._controller: FreedriveController | None = None
        self._ending = False
        self._held_cycles = 0
        """Number of cycles for which the joints have held their positions."""
        self._softened = False
        """Whether the torque limits of some servos may currently be reduced."""
        self._retry_s = 0.0
        self._faults: Mapping[str, JointFault] = {}
        """Faults of the joints in the last cycle, keyed by joint name."""
        self.open = False
        """Whether a person can move the joints by hand now or shortly."""

    @property
    def free(self) -> bool:
        """Whether the joints can be moved by hand now."""
        return self.open and self._controller is not None and self._controller.free

    @property
    def soft(self) -> list[str]:
        """Joints whose torque limits may currently be reduced."""
        reduced = frozenset[str]().union(*(torque.reduced for _, torque in self._parts))
        return [joint for joint in self._joints if joint in reduced]

    def begin(self) -> None:
        """Reduce the torque limits, and switch to the freedrive controller. Raises ArmError."""
        self._in_loop(self._begin)

    def end(self) -> None:
        """Make the joints hold their positions, and return immediately. ``open`` becomes False once the joints hold
        their positions."""
        self._ending = self.open
        if self._controller is not None:
            self._controller.holds = self.open

    def update(self, faults: Mapping[str, JointFault], now_s: float) -> None:
        """End the freedrive if this was requested or if its controller was deactivated.

        Args:
            faults: Faults of the joints in this cycle, keyed by joint name.
            now_s: Time of the cycle, in seconds.
        """
        self._faults = faults
        if not self.open:
            if self._softened and now_s >= self._retry_s:
                self._stiffen(faults, now_s)
            return
        ended = not self._takeover.active
        held = self._ending and self._controller is not None and self._controller.held
        self._held_cycles = self._held_cycles + 1 if held else 0
        if ended or self._held_cycles >= HELD_CYCLES:
            if ended:
                LOG.warning("freedrive has ended because its controller was deactivated")
            self._stiffen(faults, now_s)
            try:
                self._takeover.give_back()
            finally:
                self.open = self._ending = False  # Set this flag last, because other threads wait for it.

    def _begin(self) -> None:
        if self.open:
            raise ArmBusyError("the arm is already in freedrive")
        unknown = [name for name in self._joints if name in self._faults and self._faults[name].kind != "no_torque"]
        if unknown:  # Writing to a servo that does not respond would delay the loop.
            raise ArmError(f"the arm cannot be moved by hand: {self._faults[unknown[0]].text}")
        if self._controller is None or FREEDRIVE not in self._stack.loop.manager.registry.loaded:
            self._controller = self._load()
        self._controller.holds, self._ending = False, False
        self._takeover.take()
        self.open = self._softened = True  # From here on, ``update`` restores the torque limits, even after an error.
        problems: list[str] = []
        for component, torque in self._parts:
            try:
                problems += torque.reduce() if component.active else ()
            except DriverError as error:
                problems.append(str(error))
        if problems:
            self.end()
            raise ArmError(f"the arm cannot be moved by hand, and holds its position: {'; '.join(problems)}")

    def _load(self) -> FreedriveController:
        """Load the controller. Raises ArmError if a joint would sink."""
        joints = _guidable(
            self._stack.files, self._joints, {j for part, _ in self._parts for j in part.hardware.joints}
        )
        controller = FreedriveController(FREEDRIVE, list(map(guided_joint, joints)), self._stack.loop.hardware.joints)
        self._stack.loop.manager.registry.add(controller)
        return controller

    @cached_property
    def _parts(self) -> list[tuple[Component, SoftTorque]]:
        """Components whose torque limits can be reduced."""
        components = self._stack.loop.hardware.components
        return [(one, one.hardware.soft_torque) for one in components if isinstance(one.hardware, Softening)]

    def _stiffen(self, silent: Collection[str], now_s: float) -> None:
        """Restore the torque limits of all components that can be reached."""
        self._retry_s = now_s + RETRY_S
        for component, torque in self._parts:
            if not (torque.reduced and component.sound):
                continue
            try:
                torque.restore(silent)
            except DriverError as error:  # The next cycle detects that the port was lost.
                LOG.error("%s: the torque limits are still reduced: %s", component.name, error)
        self._softened = any(torque.reduced for _, torque in self._parts)


def _guidable(files: Files, names: Sequence[str], with_servos: set[str]) -> list[Joint]:
    """Return the joints that a person can move without the arm sinking. Raises ArmError."""
    joints, hands = [joint for joint in files.robot.joints if joint.name in names], files.hand_joints
    without = [name for name in names if name not in with_servos]
    unknown = [joint.name for joint in joints if joint.compliance is None and joint.name not in hands]
    carried = any(joint.gravity_compensation for joint in joints)
    if without or unknown or not carried:
        if without:
            why = f"{', '.join(without)} {'have' if len(without) > 1 else 'has'} no servo"
        else:
            why = f"the stiffness of {', '.join(unknown)} is unknown" if unknown else "its gravity is not compensated"
        raise ArmError(
            f"the arm cannot be made compliant because {why}: disable its torque instead (`teach record --limp`), and "
            "hold the arm"
        )
    return joints

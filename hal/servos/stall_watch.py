"""Detect servos that push with full drive without moving, which would overheat the motor of a gripper.

Every stalled joint is reported. The drive is reduced only for joints with a ``torque_limit`` below 1, because such a
limit prevents the servo's own overload protection from acting. A joint with full torque still has that protection.
The drive of such a joint is not reduced, because it may carry a load and would fall. The drive alone does not
distinguish a load from an obstacle.

The drive is reduced by moving the goal closer to the joint. This works with servos of every make, without writing a
register, and the next motion has the full torque limit again.
"""

import logging
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from hal.joint import Joint
from hal.servos.fault_log import FaultLog
from hal.types import Stall

STALL_S: Final = 1.0
"""Maximum time a joint may push without moving before its drive is reduced, in seconds. An STS's own protection reacts
after 2 s."""
PRESSING: Final = 0.8
"""Minimum drive at which a servo counts as pushing, as a fraction of the torque limit."""
HOLDING: Final = 0.36
"""Reduced drive, as a fraction of the torque limit. With a limit of 50 %, the reduced drive is 18 %, which is less than
an STS's protective torque of 20 %.
"""
SETTLE_S: Final = 0.8
"""Time a servo needs to react to the closer goal before its measured drive is used."""
WEAKEN_S: Final = 0.5
"""Time constant with which the goal moves closer to the joint while the drive is still too high."""
STRENGTHEN_PER_S: Final = 0.05
"""Speed at which the goal moves away from the joint while the drive is too low. The value is a fraction of the distance
at full drive, per second."""
STILL_TURNS: Final = 0.005
"""Maximum motion at which a joint counts as not moving, in turns of the shaft. This margin covers backlash and soft
fingers."""
FREE_TURNS: Final = 0.02
"""Minimum motion toward the goal after which a joint counts as free again, in turns of the shaft."""
NEW_COMMAND_TURNS: Final = 0.005
"""Minimum change of a command that counts as a motion, in turns of the shaft."""
NEW_MOTION_S: Final = 1.0
"""Minimum time a command must be at rest before the next change counts as a new motion, in seconds."""
WARN_S: Final = 10.0
"""Duration of the warning about a gripper that has closed on an object, in seconds. After this time, holding the object
is normal.
"""


@dataclass(slots=True)
class _Press:
    """State of one joint. Positions are in counts of the joint's servo."""

    began: int
    """Position at the beginning of the motion."""
    command: int
    """Commanded position, accurate to within ``NEW_COMMAND_TURNS``."""
    anchor: int
    """Position at which the drive was reduced, or the furthest position to which the object has yielded since then."""
    resting_s: float = 0.0
    """Time since the command came to rest, in seconds."""
    pressed: list[int] = field(default_factory=list)
    """Positions in the latest cycles in which the servo pushed without moving, covering at most ``STALL_S``."""
    held_s: float = 0.0
    """Time since the drive was first reduced, in seconds."""
    ahead: float | None = None
    """Distance from the joint to its goal while the drive is reduced; None if it is not reduced."""
    direction: int = 1
    moved: bool = False
    """Whether the joint moved before it began to push."""
    goal: int = 0


class StallWatch:
    """Stall detection for the joints of one component."""

    def __init__(self, full_ahead: Mapping[str, float]) -> None:
        """Create the detection.

        Args:
            full_ahead: Distance from a joint to its goal at full drive, in counts, keyed by joint name.
        """
        self.stalls: dict[str, Stall] = {}
        """Joints that press without moving, keyed by name."""
        self.log = FaultLog()
        """Log of the events of a cycle, which is flushed by the caller of ``goal``."""
        self._full_ahead = full_ahead
        self._presses: dict[str, _Press] = {}

    def restart(self, names: Iterable[str]) -> None:
        """Discard the state of these joints, for example when they are activated."""
        for name in names:
            self.stalls.pop(name, None)
            self._presses.pop(name, None)

    def goal(self, joint: Joint, command: int, here: int | None, load: float, period_s: float) -> int | None:
        """Return the goal of a joint if its drive is reduced.

        Args:
            joint: The joint.
            command: Commanded position, in counts.
            here: Measured position, in counts; None if the joint was not measured.
            load: Measured drive as a fraction of full drive; NaN if unknown.
            period_s: Period of the control loop, in seconds.

        Returns:
            The goal, in counts; None if the drive is not reduced.
        """
        press = self._presses.get(joint.name)
        if here is None:
            return press.goal if press is not None and press.ahead is not None else None
        press = self._followed(press, joint, command, here, period_s)
        pressing = press.ahead is None and self._presses_too_long(press, joint, here, load, period_s)
        if joint.torque_limit == 1.0:
            self._name(joint, pressing)
        elif pressing:
            self._reduce(press, joint, here)
        if press.ahead is None:
            return None
        turn = joint.model.counts_per_turn
        travel = (here - press.anchor) * press.direction
        if travel > FREE_TURNS * turn:
            text = f"{joint.name}: servo {joint.servo_id} moves again with its full torque limit"
            self.log.note(logging.INFO, joint.name, joint.servo_id, text)
            self._begin(joint, command, here)
            return None
        press.anchor = here if travel < 0 else press.anchor  # soft fingers yield to the object that they hold
        press.ahead = self._eased(press, press.ahead, joint, load, period_s)
        press.held_s += period_s
        self.stalls[joint.name] = Stall(_text(press, joint), not press.moved or press.held_s < WARN_S)
        apart = (command - here) * press.direction
        press.goal = here + press.direction * round(min(press.ahead, max(apart, 0)))
        return press.goal

    def _followed(self, press: _Press | None, joint: Joint, command: int, here: int, period_s: float) -> _Press:
        """Return the state of a joint after a command. A changed command ends the reduction and may begin a new
        motion."""
        if press is None:
            return self._begin(joint, command, here)
        if abs(command - press.command) <= NEW_COMMAND_TURNS * joint.model.counts_per_turn:
            press.resting_s += period_s
            return press
        began = here if press.resting_s >= NEW_MOTION_S else press.began
        return self._begin(joint, command, here, began)

    def _begin(self, joint: Joint, command: int, here: int, began: int | None = None) -> _Press:
        self.stalls.pop(joint.name, None)
        press = self._presses[joint.name] = _Press(here if began is None else began, command, here)
        return press

    def _presses_too_long(self, press: _Press, joint: Joint, here: int, load: float, period_s: float) -> bool:
        press.anchor = here
        if not abs(load) >= PRESSING * joint.torque_limit:  # also for NaN
            press.pressed.clear()
            return False
        press.pressed.append(here)
        longest = math.ceil(STALL_S / period_s - 1e-9) + 1
        del press.pressed[:-longest]
        while max(press.pressed) - min(press.pressed) > STILL_TURNS * joint.model.counts_per_turn:
            del press.pressed[0]
        return len(press.pressed) == longest

    def _name(self, joint: Joint, pressing: bool) -> None:
        """Report the stall of a joint that has full torque and whose drive is not reduced."""
        if not pressing:
            self.stalls.pop(joint.name, None)
        elif joint.name not in self.stalls:
            self.stalls[joint.name] = Stall(_full_torque_text(joint), warns=True)
            text = f"{joint.name}: {self.stalls[joint.name].text}"
            self.log.note(logging.WARNING, joint.name, joint.servo_id, text)

    def _reduce(self, press: _Press, joint: Joint, here: int) -> None:
        press.direction = 1 if press.command > here else -1
        press.ahead = self._full_ahead[joint.name] * HOLDING * joint.torque_limit
        press.moved = abs(here - press.began) > STILL_TURNS * joint.model.counts_per_turn
        level = logging.INFO if press.moved else logging.WARNING
        self.log.note(level, joint.name, joint.servo_id, f"{joint.name}: {_text(press, joint)}")

    def _eased(self, press: _Press, ahead: float, joint: Joint, load: float, period_s: float) -> float:
        """Return the next ``ahead``, corrected if the servo is stiffer or softer than assumed."""
        share = HOLDING * joint.torque_limit
        if press.held_s >= SETTLE_S and abs(load) > 1.1 * share:
            return ahead * max(1.0 - period_s / WEAKEN_S, 0.0)
        if press.held_s >= SETTLE_S and abs(load) < 0.8 * share:
            return ahead + STRENGTHEN_PER_S * self._full_ahead[joint.name] * period_s
        return ahead


def _full_torque_text(joint: Joint) -> str:
    return (
        f"servo {joint.servo_id} has pressed with at least {PRESSING:.0%} of its torque for {STALL_S:g} s without "
        "motion: the joint is blocked or overloaded. Its torque is not reduced, because a loaded joint would fall: "
        "move it back or remove the load before the servo's own protection disables its torque"
    )


def _text(press: _Press, joint: Joint) -> str:
    pressed = (
        f"servo {joint.servo_id} has pressed with its torque limit of {joint.torque_limit:.0%} for {STALL_S:g} s "
        f"without motion and holds with {HOLDING * joint.torque_limit:.0%} until its next motion"
    )
    if press.moved:
        return f"{pressed}: the joint has gripped something or is blocked"
    return f"{pressed}: the joint has not moved at all, so it is jammed or blocked. Move it back and check it"

"""The watch for servos that drive with all they may and do not move: a gripper that presses for ever burns its motor.

Every joint is watched and named. The drive is reduced only where a ``torque_limit`` below 1 keeps the servo's own
overload protection from acting. A joint with its whole torque has that protection, and it may carry a load: drive
alone does not tell a load from an obstacle, and a joint that carries would fall with less. The drive is reduced by the
goal: the nearer it is, the less a servo pulls. So it works with every make, writes no register, and the next motion has
the whole limit again.
"""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from hal.joint import Joint
from hal.servos.fault_log import FaultLog
from hal.types import Stall

STALL_S: Final = 1.0
"""Time for which a joint may press without motion before its drive is reduced. An STS's own protection takes 2 s."""
PRESSING: Final = 0.8
"""Share of the torque limit above which a servo presses."""
HOLDING: Final = 0.36
"""Share of the torque limit that is left to hold with: of 0.5 it is 18 %, below an STS's protective torque of 20 %."""
SETTLE_S: Final = 0.8
"""Time that a servo needs to follow to the nearer goal; then its measured drive counts."""
WEAKEN_S: Final = 0.5
"""Time in which a goal at which the servo still pulls too hard would come all the way."""
STRENGTHEN_PER_S: Final = 0.05
"""Share of the way to full drive by which a goal goes ahead in a second, if the servo pulls too weakly."""
STILL_TURNS: Final = 0.005
"""Turns of the shaft within which a joint counts as not moving: backlash, and how the fingers give way."""
FREE_TURNS: Final = 0.02
"""Turns of the shaft towards its goal after which a joint is free again."""
NEW_COMMAND_TURNS: Final = 0.005
"""Turns of the shaft by which a command must change to belong to a motion."""
NEW_MOTION_S: Final = 1.0
"""Time for which a command must have been at rest before the next change begins another motion."""
WARN_S: Final = 10.0
"""Time for which fingers that have closed on something are reported with a warning; afterwards they hold it."""


@dataclass(slots=True)
class _Press:
    """One joint's state; places are in counts of its servo."""

    began: int
    """Where the joint was when the motion to its command began."""
    command: int
    """The command, within ``NEW_COMMAND_TURNS``."""
    anchor: int
    """Where the joint was when it last moved."""
    resting_s: float = 0.0
    """How long the command has been at rest."""
    pressed_s: float = 0.0
    held_s: float = 0.0
    """How long the drive has been reduced."""
    ahead: float | None = None
    """How far ahead of the joint its goal is while the drive is reduced; None: it is not reduced."""
    direction: int = 1
    moved: bool = False
    """Whether the joint moved at all before it pressed."""
    goal: int = 0


class StallWatch:
    """The watch over one component's joints; ``stalls`` has those that press, by name."""

    def __init__(self, full_ahead: Mapping[str, float]) -> None:
        """``full_ahead``: by joint, the counts by which a goal is ahead when its servo pulls with full drive."""
        self.stalls: dict[str, Stall] = {}
        self.log = FaultLog()
        """The log of a cycle's events; who asks for the goals flushes it."""
        self._full_ahead = full_ahead
        self._presses: dict[str, _Press] = {}

    def restart(self, names: Iterable[str]) -> None:
        """Forget everything of these joints: they are activated anew."""
        for name in names:
            self.stalls.pop(name, None)
            self._presses.pop(name, None)

    def goal(self, joint: Joint, command: int, here: int | None, load: float, period_s: float) -> int | None:
        """The goal of a joint whose drive is reduced.

        Args:
            joint: The joint.
            command: The position that it is commanded to, in counts.
            here: The measured position in counts; None: the joint was not measured.
            load: The measured drive as a share of full drive; NaN if it is unknown.
            period_s: The period.

        Returns:
            The goal in counts; None if the drive is not reduced.
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
        way = (here - press.anchor) * press.direction
        if way > FREE_TURNS * turn:
            text = f"{joint.name}: servo {joint.servo_id} moves again with its whole torque limit"
            self.log.note(logging.INFO, joint.name, joint.servo_id, text)
            self._begin(joint, command, here)
            return None
        press.anchor = here if way < 0 else press.anchor  # fingers that give way follow what they hold
        press.ahead = self._eased(press, press.ahead, joint, load, period_s)
        press.held_s += period_s
        self.stalls[joint.name] = Stall(_text(press, joint), not press.moved or press.held_s < WARN_S)
        apart = command - here
        apart -= round(apart / turn) * turn
        press.goal = here + press.direction * round(min(press.ahead, max(apart * press.direction, 0)))
        return press.goal

    def _followed(self, press: _Press | None, joint: Joint, command: int, here: int, period_s: float) -> _Press:
        """The state after this command. One that changes ends the reduction, and may begin another motion."""
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
        still = abs(here - press.anchor) <= STILL_TURNS * joint.model.counts_per_turn
        if not still or not abs(load) >= PRESSING * joint.torque_limit:  # NaN presses nothing
            press.anchor, press.pressed_s = here, 0.0
            return False
        press.pressed_s += period_s
        return press.pressed_s >= STALL_S - 1e-9

    def _name(self, joint: Joint, pressing: bool) -> None:
        """Name a joint with its whole torque for as long as it presses."""
        if not pressing:
            self.stalls.pop(joint.name, None)
        elif joint.name not in self.stalls:
            self.stalls[joint.name] = Stall(_text_of_whole_torque(joint), warns=True)
            text = f"{joint.name}: {self.stalls[joint.name].text}"
            self.log.note(logging.WARNING, joint.name, joint.servo_id, text)

    def _reduce(self, press: _Press, joint: Joint, here: int) -> None:
        press.direction = 1 if press.command > here else -1
        press.ahead = self._full_ahead[joint.name] * HOLDING * joint.torque_limit
        press.moved = abs(here - press.began) > STILL_TURNS * joint.model.counts_per_turn
        level = logging.INFO if press.moved else logging.WARNING
        self.log.note(level, joint.name, joint.servo_id, f"{joint.name}: {_text(press, joint)}")

    def _eased(self, press: _Press, ahead: float, joint: Joint, load: float, period_s: float) -> float:
        """The next ``ahead``, corrected where the servo is stiffer or softer than assumed."""
        share = HOLDING * joint.torque_limit
        if press.held_s >= SETTLE_S and abs(load) > 1.1 * share:
            return ahead * max(1.0 - period_s / WEAKEN_S, 0.0)
        if press.held_s >= SETTLE_S and abs(load) < 0.8 * share:
            return ahead + STRENGTHEN_PER_S * self._full_ahead[joint.name] * period_s
        return ahead


def _text_of_whole_torque(joint: Joint) -> str:
    return (
        f"servo {joint.servo_id} has driven with at least {PRESSING:.0%} of its torque for {STALL_S:g} s without "
        "motion: something is in the joint's way, or it carries too much. Its drive is not reduced, because a loaded "
        "joint would fall: move it back, or take the load off, before the servo's own protection releases it"
    )


def _text(press: _Press, joint: Joint) -> str:
    pressed = (
        f"servo {joint.servo_id} has pressed with its torque limit of {joint.torque_limit:.0%} for {STALL_S:g} s "
        f"without motion and holds with {HOLDING * joint.torque_limit:.0%} until its next motion"
    )
    if press.moved:
        return f"{pressed}: the joint grips something, or something is in its way"
    return f"{pressed}: the joint has not moved at all, it is jammed or blocked. Move it the other way, and look at it"

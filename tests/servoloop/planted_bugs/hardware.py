"""Bugs in the hardware components and in the drivers."""

import math
from collections.abc import Collection, Sequence
from typing import Any

import pytest

from controller import shutdown
from controller.loop import ControlLoop
from drivers.bus.bus import Bus
from drivers.driver_errors import ServoError
from hal.leaps import Plausibility
from hal.servos.soft_torque import SoftTorque
from tests.servoloop.planted_bugs.registry import detected_by


@detected_by("ends as chosen")
def torque_stays_enabled_without_an_error(patch: pytest.MonkeyPatch) -> None:
    def wrong(bus: Bus, servo_ids: Sequence[int]) -> list[ServoError]:
        bus._line.send(bus._servos.torque_off(servo_ids))
        return []

    patch.setattr(Bus, "torque_off", wrong)


@detected_by("activated as configured")
def torque_limits_that_are_not_restored_are_forgotten(patch: pytest.MonkeyPatch) -> None:
    restore = SoftTorque.restore

    def wrong(torque: SoftTorque, silent: Collection[str] = ()) -> None:
        restore(torque, silent)
        torque.reduced = frozenset()

    patch.setattr(SoftTorque, "restore", wrong)


@detected_by("reported truly")
def rejected_positions_confirm_later_positions(patch: pytest.MonkeyPatch) -> None:
    leap = Plausibility.leap

    def wrong(check: Plausibility, position: float, now_s: float, driven: bool) -> float | None:
        rejected = check._rejected
        found = leap(check, position, now_s, driven)
        if math.isnan(check._rejected):
            check._rejected = rejected
        return found

    patch.setattr(Plausibility, "leap", wrong)


@detected_by("ends as chosen")
def joints_outside_the_park_pose_move_to_zero(patch: pytest.MonkeyPatch) -> None:
    park = shutdown._park

    def wrong(loop: ControlLoop, pose: Any, scale: float, hurry: Any) -> bool:
        names = [name.rpartition("/")[0] for name in loop.hardware.command_interfaces]
        return park(loop, dict.fromkeys(names, 0.0) | pose, scale, hurry)

    patch.setattr(shutdown, "_park", wrong)

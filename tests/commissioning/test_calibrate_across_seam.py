"""Automatic calibration of a single joint, with the encoder's seam in its travel."""

from collections.abc import Callable
from math import tau

import pytest

from commissioning.calibrate.by_hand import CalibrationTask
from commissioning.calibrate.by_itself import ByItself
from commissioning.calibrate.plan import ArmPlan, AutoPlan, JointPlan
from commissioning.calibrate.result import travel_warnings
from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos.angles import shortest
from hal.joint import Joint
from hal.types import JointLimits
from tests.commissioning.loose import Loose, Port

JOINT = Joint("joint", 1, sts.STS3215, JointLimits(-0.4, 0.4, 4.0, 12.0, 120.0))
PLAN = ArmPlan(joints={"joint": JointPlan(positive="to the left")})
TURN = JOINT.model.counts_per_turn
ZERO_RAD = 0.02


class LeftWatcher:
    """A person who first sees the joint turn to the left."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def say(self, text: str) -> None:
        self.heard.append(text)

    def until_done(self, task: CalibrationTask, update: Callable[[], None]) -> None:
        raise AssertionError(f"no joint is moved by hand: {task}")

    def moved_so(self, joint: str, text: str) -> bool:
        return True


def calibrated(zero: int, start: int, plan: ArmPlan = PLAN) -> list[str]:
    """Calibrate a joint that is at ``start`` (counts), check its zero, and return the messages to the user."""
    loose, watcher = Loose(JOINT.model, counts=start), LeftWatcher()
    zero_rad = (zero + 0.5) * tau / TURN
    loose.plant.stops = zero_rad + JOINT.limits.lower, zero_rad + JOINT.limits.upper

    def open_bus() -> Bus:
        return Bus(Port(loose.line, loose.clock), loose.clock, {1: JOINT.model})

    found = ByItself(open_bus, [JOINT], plan, watcher, loose.clock).run()["joint"]
    seam = found.counting.seam(JOINT.model) or 0
    assert abs(shortest(zero, found.zero_counts + seam, TURN)) * tau / TURN <= ZERO_RAD
    assert found.sign == 1 and travel_warnings(JOINT, found) == ""
    return watcher.heard


@pytest.mark.parametrize(("zero", "start"), [(0, 100), (200, -50), (3900, 3700)])
def test_both_stops_are_found_across_the_seam(zero: int, start: int) -> None:
    calibrated(zero, start)


@pytest.mark.parametrize(("start", "clear"), [(4000, 0.25), (100, -0.25)])
def test_a_joint_that_moves_out_of_the_way_across_the_seam_is_not_blocked(start: int, clear: float) -> None:
    plan = PLAN.model_copy(update={"auto": AutoPlan(start={"joint": 0.0}, clear={"joint": clear})})
    assert not [text for text in calibrated(start, start, plan) if "did not reach" in text]

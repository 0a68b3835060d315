"""Automatic calibration finds the stops gently and slowly, wherever the seam lies."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pytest

from commissioning.calibrate.by_itself import ByItself
from commissioning.calibrate.result import travel_warnings, turns_freely
from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import FASTEST_RAD_S, StoppedError
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, PortLost, PortMissing
from drivers.servos import sts
from drivers.servos.catalog import MODELS
from hal.joint import Joint
from hal.types import FloatArray
from servoloop.stack.arm_folders import find_arm
from tests.commissioning.arm import JOINTS, PLAN, Onlooker, UnalignedArm, off_rad
from tests.drivers.fault_lines import CYCLES

ZERO_RAD, ZERO_WITH_BACKLASH_RAD = 0.02, 0.025
FIRST = (0, 1.0), (15, 0.0)
"""Seed and backlash (degrees). The hand of arm 15 begins 30 counts from its encoder seam."""
SEEDS = range(CYCLES // 1000)
FURTHER = [(seed, gap) for seed in SEEDS[1:] for gap in (0.0, 1.0) if (seed, gap) not in FIRST]
"""Arms for ``make soak``: ten in total, with and without backlash."""


@pytest.mark.parametrize(
    ("seed", "backlash_deg"),
    [
        *(pytest.param(*one, marks=pytest.mark.slow) for one in FIRST),
        *(pytest.param(*one, marks=pytest.mark.soak) for one in FURTHER),
    ],
)
def test_auto_calibration_finds_zeros_and_directions_slowly(seed: int, backlash_deg: float) -> None:
    arm = UnalignedArm(seed, backlash_deg)
    fastest = 0.0

    def watching() -> bool:
        nonlocal fastest
        fastest = max(fastest, arm.fastest_rad_s)
        return False

    found = by_itself(arm, stopped=watching).run()
    assert fastest < 2.0 * FASTEST_RAD_S or backlash_deg, "within its backlash a joint falls"
    allowed_rad = ZERO_WITH_BACKLASH_RAD if backlash_deg else ZERO_RAD
    for joint in JOINTS:
        made = found[joint.name]
        assert made.sign == arm.coupling(joint.name).sign, joint.name
        assert off_rad(arm, joint, made) <= allowed_rad, joint.name
        assert travel_warnings(joint, made) == ""
    for servo in arm.line.servos:
        limits = servo.memory.get(sts.min_position), servo.memory.get(sts.max_position)
        assert (servo.memory.get(sts.torque_enable), limits) == (0, (0, 4095))


def by_itself(arm: UnalignedArm, **options: object) -> ByItself:
    arm.hand.release()
    arm.fastest_rad_s = 0.0
    return ByItself(lambda: arm.open_bus(JOINTS), JOINTS, PLAN, Onlooker(arm), arm.clock, **options)  # type: ignore[arg-type]


def is_limp_with_its_limits(arm: UnalignedArm) -> bool:
    arm.line.advance(arm.clock.now())
    kept = [(s.memory.get(sts.min_position), s.memory.get(sts.max_position)) for s in arm.line.servos]
    return not any(s.memory.get(sts.torque_enable) for s in arm.line.servos) and kept == [(0, 4095)] * len(kept)


def test_stopping_lets_the_arm_sink_and_releases_it() -> None:
    arm = UnalignedArm(1)
    stop_s = arm.clock.now() + 12.0
    with pytest.raises(StoppedError, match="stopped: the arm's torque is disabled"):
        by_itself(arm, stopped=lambda: arm.clock.now() > stop_s).run()
    assert is_limp_with_its_limits(arm)
    assert arm.fastest_rad_s < 2.0, "it sinks, and does not fall"


@pytest.mark.slow
def test_a_joint_without_a_stop_is_named() -> None:
    arm = UnalignedArm(1)
    arm.world.model.joint("joint2").range = (-20.0, 20.0)
    with pytest.raises(CalibrationError, match=r"joint2 \(servo 2\) moved by .* without finding a stop"):
        by_itself(arm).run()
    assert is_limp_with_its_limits(arm)


@pytest.mark.slow
def test_an_obstacle_shows_in_the_travel() -> None:
    arm = UnalignedArm(1)
    arm.world.model.joint("joint3").range = (-1.2, 2.0)
    found = by_itself(arm).run()
    assert [bool(travel_warnings(joint, found[joint.name])) for joint in JOINTS] == [j.name == "joint3" for j in JOINTS]


def test_a_servo_that_stops_answering_is_named() -> None:
    arm = UnalignedArm(1)

    def break_one() -> bool:
        if arm.clock.now() > 20.0:
            arm.line.faults.silence(6)
        return False

    with pytest.raises(DriverError, match="servo 6"):
        by_itself(arm, stopped=break_one).run()
    others = [servo.memory.get(sts.torque_enable) for servo in arm.line.servos if servo.servo_id != 6]
    assert not any(others), "only the servo that does not receive the packet keeps its torque"


def test_an_unplugged_adapter_is_reported_with_a_torque_warning() -> None:
    arm = UnalignedArm(1)
    open_bus, pulled = arm.open_bus, list[bool]()

    def opened(joints: Sequence[Joint]) -> Bus:
        if pulled:
            raise PortMissing("it is not there")
        return open_bus(joints)

    def pull() -> bool:
        if arm.clock.now() > 12.0 and not pulled:
            pulled.append(True)
            arm.port.unplug()
        return False

    arm.open_bus = opened  # type: ignore[method-assign]
    with pytest.raises(PortLost, match="unplugged") as lost:
        by_itself(arm, stopped=pull).run()
    assert "torque may still be on: virtual was unplugged" in lost.value.__notes__[0]
    assert (
        "the servos could not be restarted: it is not there. Switch their supply off and on" in lost.value.__notes__[-1]
    )


def test_an_error_while_the_limits_are_disabled_restarts_the_servos() -> None:
    arm = UnalignedArm(1)
    memories = {servo.servo_id: servo.memory for servo in arm.line.servos}

    def hears(servo_id: int) -> bool:
        return servo_id != 5 or memories[4].get(sts.max_position) != 0

    arm.line.faults.on_instruction.append(hears)
    with pytest.raises(DriverError, match="servo 5") as silent:
        by_itself(arm).run()
    assert is_limp_with_its_limits(arm)
    assert not hasattr(silent.value, "__notes__"), "no warning that limits are disabled"


def test_unsupported_servos_are_named_before_any_motion() -> None:
    arm = UnalignedArm(1)
    joints = [replace(JOINTS[0], model=MODELS["scs15"]), *JOINTS[1:]]
    with pytest.raises(CalibrationError, match="joint1: automatic calibration works only with STS servos"):
        ByItself(lambda: arm.open_bus(JOINTS), joints, PLAN, Onlooker(arm), arm.clock).run()


FOLDED = {"so101": (0.0, -1.7, 1.65, 0.9, 0.0, -0.1), "so100": (0.0, -1.55, 1.35, 1.25, 0.7, -0.1)}
"""Joint positions at the start. The wrist of an SO-100 turns freely and is moved to its pose by hand."""


def laid_down(arm: UnalignedArm) -> FloatArray:
    """Return the joint positions after the torque was released."""
    arm.hand.release()
    arm.clock.sleep_until(2.0)
    arm.line.advance(arm.clock.now())
    return arm.world.position()


@dataclass
class Mistaken(Onlooker):
    """A person who gives wrong answers a given number of times per joint."""

    mistakes: int = 1

    def moved_so(self, joint: str, text: str) -> bool:
        seen = super().moved_so(joint, text)
        return not seen if self.asked.count(joint) <= self.mistakes else seen


@pytest.mark.slow
def test_a_wrong_direction_is_asked_for_again_if_the_joint_is_blocked() -> None:
    arm = UnalignedArm(3, name="so101", start=FOLDED["so101"])
    plan = find_arm("so101").file.calibration
    laid_down(arm)
    watcher = Mistaken(arm, plan.joints)
    found = ByItself(lambda: arm.open_bus(arm.joints), arm.joints, plan, watcher, arm.clock).run()
    assert watcher.asked.count("wrist_flex") == 2
    assert any("wrist_flex did not reach its goal" in text for text in watcher.heard)
    assert found["wrist_flex"].sign == arm.coupling("wrist_flex").sign


@pytest.mark.slow
def test_a_joint_that_is_blocked_in_both_directions_is_named() -> None:
    arm = UnalignedArm(3, name="so101", start=FOLDED["so101"])
    plan = find_arm("so101").file.calibration
    laid_down(arm)
    with pytest.raises(CalibrationError, match=r"wrist_flex \(servo 4\) is blocked before it reaches the position"):
        ByItself(
            lambda: arm.open_bus(arm.joints), arm.joints, plan, Mistaken(arm, plan.joints, mistakes=2), arm.clock
        ).run()
    assert is_limp_with_its_limits(arm)


GAPS_DEG = (0.0, 1.0) if CYCLES > 1000 else (1.0,)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "seed", "backlash_deg"), [(name, seed, gap) for name in FOLDED for seed in SEEDS for gap in GAPS_DEG]
)
def test_a_folded_arm_is_calibrated_automatically_and_folds_again(name: str, seed: int, backlash_deg: float) -> None:
    plan = find_arm(name).file.calibration
    arm = UnalignedArm(seed, backlash_deg, name, FOLDED[name])
    lay = laid_down(arm)
    watcher = Onlooker(arm, plan.joints)
    found = ByItself(lambda: arm.open_bus(arm.joints), arm.joints, plan, watcher, arm.clock).run()
    assert not {"shoulder_lift", "elbow_flex", "gripper"} & set(watcher.asked), "the folded pose shows these"
    for joint in arm.joints:
        made = found[joint.name]
        assert made.sign == arm.coupling(joint.name).sign, joint.name
        assert off_rad(arm, joint, made) <= ZERO_RAD, joint.name
        assert travel_warnings(joint, made) == ""
    arm.clock.sleep_until(arm.clock.now() + 1.0)
    arm.line.advance(arm.clock.now())
    fixed = [not turns_freely(joint) for joint in arm.joints]
    assert arm.world.position()[fixed] == pytest.approx(lay[fixed], abs=0.1)

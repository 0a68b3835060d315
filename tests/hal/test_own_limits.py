"""Tests of servos whose own position limits are narrower than those of their joint."""

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.driver_errors import DriverError, ServoRefused
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, x
from drivers.servos.register import Register, ServoModel
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_settings import check_reach
from hal.types import JointLimits
from tests.drivers.fault_lines import KINDS, Line
from tests.hal.bench import IDS, JOINTS, Bench

LIMITED = (
    (sts.STS3215, sts.min_position, sts.max_position),
    (scs.SCS0009, scs.min_position, scs.max_position),
    (dxl.AX_12A, dxl.cw_angle_limit, dxl.ccw_angle_limit),
    (dxl.MX_28, dxl.cw_angle_limit, dxl.ccw_angle_limit),
    (x.XL430_W250, x.min_position_limit, x.max_position_limit),
)


@pytest.mark.parametrize(("model", "lowest", "highest"), LIMITED, ids=lambda value: getattr(value, "name", ""))
def test_a_servo_with_limits_narrower_than_its_joint_is_refused(
    model: ServoModel, lowest: Register, highest: Register
) -> None:
    kind = next(kind for kind in KINDS if model in kind.models.values())
    servo_id = next(i for i, other in kind.models.items() if other is model)
    limits = JointLimits(-0.5, 0.7, 3.0, 5.0, 50.0)
    joint = Joint("j", servo_id, model, limits, sign=-1, zero_counts=(model.last_count + 1) // 2)
    first, last = joint.counts_range()

    def arm_with(low: int, high: int) -> ServoHardware:
        line = Line(kind)
        line.servos.servo(servo_id).memory.put(lowest, low)
        line.servos.servo(servo_id).memory.put(highest, high)
        return ServoHardware("arm", [joint], lambda: line.bus, line.clock)

    for low, high in ((first + 1, last), (first, last - 1), (first + 9, last + 9), (first - 9, last - 9)):
        with pytest.raises(DriverError, match=f"has position limits {low} to {high} counts") as caught:
            arm_with(low, high).configure()
        assert f"its joint moves from {first} to {last}" in str(caught.value)
    arm_with(first, last).configure()


@given(
    st.sampled_from((-1, 1)),
    st.sampled_from((None, 0.01, 0.03)),
    st.integers(300, 3800),
    st.tuples(st.integers(0, 4095), st.integers(0, 4095)).map(sorted),
)
def test_the_suggested_limits_are_within_the_joint_limits_and_work(
    sign: int, metres: float | None, zero_counts: int, own: list[int]
) -> None:
    scale = metres or 1.0
    limits = JointLimits(-0.4 * scale, 0.4 * scale, 3.0, 5.0, 50.0)
    joint = Joint("j", 1, sts.STS3215, limits, sign=sign, zero_counts=zero_counts, transmission=scale)
    try:
        check_reach(joint, (own[0], own[1]))
    except ServoRefused as error:
        advice = re.search(r"URDF to (\S+) to (\S+)$", error.text)
        if advice is None:
            assert "correct zero_counts" in error.text
            return
        lower, upper = float(advice[1]), float(advice[2])
        assert limits.lower - 1e-6 <= lower <= upper <= limits.upper + 1e-6
        check_reach(replace(joint, limits=replace(limits, lower=lower, upper=upper)), (own[0], own[1]))
    else:
        lowest, highest = joint.counts_range()
        assert own[0] <= lowest and highest <= own[1]


def test_a_refusal_contains_both_ranges_and_suggested_limits() -> None:
    wide = Joint("j", 4, sts.STS3215, JointLimits(-3.5, 3.1, 3.0, 5.0, 50.0))
    with pytest.raises(ServoRefused) as caught:
        check_reach(wide, (100, 3900))
    assert caught.value.servo_id == 4
    assert caught.value.text == (
        "has position limits 100 to 3900 counts, but its joint moves from 0 to 4068: "
        "widen these limits in the servo, or narrow the limits in the URDF to -2.988194 to 2.840932"
    )


def test_if_the_ranges_hardly_overlap_zero_counts_is_wrong() -> None:
    joint = Joint("j", 4, sts.STS3215, JointLimits(-0.5, 0.5, 3.0, 5.0, 50.0))
    with pytest.raises(
        ServoRefused,
        match=r"in the servo, or run 'servoloop calibrate' or correct zero_counts, because the two ranges",
    ):
        check_reach(joint, (3000, 3900))


def test_a_servo_without_limits_is_accepted() -> None:
    line = Line(KINDS[0])
    for register in (sts.min_position, sts.max_position):
        line.servos.servo(1).memory.put(register, 0)
    joint = Joint("j", 1, sts.STS3215, JointLimits(-3.1, 3.1, 3.0, 5.0, 50.0))
    ServoHardware("arm", [joint], lambda: line.bus, line.clock).configure()


@pytest.mark.parametrize("above", [True, False])
@pytest.mark.parametrize("beside", [0, 3])
def test_a_joint_beyond_its_servos_limits_gets_no_torque(beside: int, above: bool) -> None:
    """A joint may start slightly outside its limits. The servo of such a joint would clip the goal to its own limits
    and move there."""
    lowest, highest = JOINTS[0].counts_range()
    stands = highest + 20 if above else lowest - 20
    own = (lowest, stands - beside) if above else (stands + beside, highest)
    bench = Bench(counts=(stands, 2000, 1500))
    for register, limit in zip((sts.min_position, sts.max_position), own, strict=True):
        bench.servos.servo(1).memory.put(register, limit)
    bench.configured()
    if not beside:
        bench.hardware.activate()
        assert bench.torque() == list(IDS)
        return
    message = (
        rf"shoulder \(servo 1\) is at {stands} counts, outside the servo's own limits {own[0]} to {own[1]}, so .* Move "
        "the joint by hand, or widen the servo's limits$"
    )
    with pytest.raises(ActivationError, match=message):
        bench.hardware.activate()
    assert bench.torque() == []
    assert bench.measured(1) == stands


def test_limits_from_the_robot_file_are_checked_after_they_are_written() -> None:
    lowest, highest = JOINTS[0].counts_range()
    wide, narrow = (
        [replace(JOINTS[0], settings=(("min_position", lowest + by), ("max_position", highest))), *JOINTS[1:]]
        for by in (0, 1)
    )
    bench = Bench(joints=narrow)
    with pytest.raises(DriverError, match=rf"has position limits {lowest + 1} to .* in the robot file's settings"):
        bench.configured()
    bench = Bench(joints=wide)
    bench.servos.servo(1).memory.put(sts.min_position, 1500)
    bench.configured()
    assert bench.held(1, sts.min_position) == lowest


def test_settings_for_continuous_rotation_are_refused() -> None:
    line = Line(next(kind for kind in KINDS if scs.SCS0009 in kind.models.values()))
    servo_id = next(i for i, model in line.kind.models.items() if model is scs.SCS0009)
    motor = (("min_position", 0), ("max_position", 0))
    joint = Joint("j", servo_id, scs.SCS0009, JointLimits(-0.5, 0.5, 3.0, 5.0, 50.0), zero_counts=512, settings=motor)
    with pytest.raises(DriverError, match="is in motor mode"):
        ServoHardware("arm", [joint], lambda: line.bus, line.clock).configure()

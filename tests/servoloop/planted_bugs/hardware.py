"""Bugs in the hardware components and in the drivers."""

import math
from collections.abc import Collection, Sequence
from typing import Any

import pytest

from controller import shutdown
from controller.loop import ControlLoop
from drivers.bus.bus import Bus
from drivers.bus.known_servos import KnownServos
from drivers.driver_errors import ServoError
from drivers.servos.series import Series
from drivers.types import ServoState
from hal.compensation.joint_offset import JointOffset
from hal.joint import Joint
from hal.leaps import Plausibility
from hal.servos import gravity_compensation
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.servo_faults import ServoFaults
from hal.servos.servo_states import ServoStates
from hal.servos.soft_torque import SoftTorque
from hal.types import ServoHealth
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


@detected_by("offsets carry the weight")
def goals_are_truncated(patch: pytest.MonkeyPatch) -> None:
    def wrong(joint: Joint, position: float) -> int:
        lower, upper = joint.counts_range()
        inside = min(max(position, joint.limits.lower), joint.limits.upper)
        return min(max(int(inside / joint.units_per_count) + joint.zero_counts, lower), upper)

    patch.setattr(Joint, "counts", wrong)


@detected_by("offsets carry the weight")
def gravity_offsets_stay_at_an_old_pose(patch: pytest.MonkeyPatch) -> None:
    offset = GravityCompensation._offset

    def wrong(carried: GravityCompensation, command: list[float], *more: Any) -> Any:
        if any(carried._torques):
            carried._weighed = command
        return offset(carried, command, *more)

    patch.setattr(GravityCompensation, "_offset", wrong)


@detected_by("offsets carry the weight")
def a_reactivation_resets_all_offsets(patch: pytest.MonkeyPatch) -> None:
    restart = GravityCompensation.restart
    patch.setattr(GravityCompensation, "restart", lambda carried, joints=None: restart(carried))


@detected_by("health is true")
def currents_have_the_unit_of_another_model(patch: pytest.MonkeyPatch) -> None:
    scales = KnownServos._scales

    def wrong(servos: KnownServos, servo_ids: Sequence[int]) -> dict[int, float | None]:
        return {i: None if unit is None else 0.00269 for i, unit in scales(servos, servo_ids).items()}

    patch.setattr(KnownServos, "_scales", wrong)


@detected_by("ends as chosen")
def lost_components_of_a_held_arm_are_released(patch: pytest.MonkeyPatch) -> None:
    check_torque = shutdown._check_torque

    def wrong(loop: ControlLoop) -> None:
        for component in loop.hardware.lost:
            shutdown._release(component)
        check_torque(loop)

    patch.setattr(shutdown, "_check_torque", wrong)


@detected_by("offsets carry the weight")
def offsets_appear_at_once_after_an_activation(patch: pytest.MonkeyPatch) -> None:
    restart = JointOffset.restart

    def wrong(offset: JointOffset) -> None:
        share = getattr(offset, "_share", 0.0)
        restart(offset)
        offset._share = share

    patch.setattr(JointOffset, "restart", wrong)


@detected_by("offsets carry the weight")
def the_whole_weight_of_a_guided_arm_is_carried(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(gravity_compensation, "GUIDED_SHARE", 1.0 - 1e-9)


@detected_by("limp joints are found")
def reset_servos_that_a_goal_drives_are_not_recognized(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Series, "drives", lambda series, state, limit: state & 0xFF == 1)


@detected_by("limp joints are found")
def torque_limits_do_not_show_resets(patch: pytest.MonkeyPatch) -> None:
    def wrong(bus: Bus, servo_id: int, share: float) -> None:
        series = bus._servos.series(servo_id)
        if series.torque_limit is None:
            limit_torque(bus, servo_id, share)
            return
        held = bus._read_with_retries(servo_id, series.max_torque)
        bus._limits[servo_id] = min(round(share * series.full_torque), held)
        bus._write_with_retries(servo_id, series.torque_limit, bus._limits[servo_id])

    limit_torque = Bus.limit_torque
    patch.setattr(Bus, "limit_torque", wrong)


@detected_by("safe wire")
def ranges_in_counts_are_rounded_outward(patch: pytest.MonkeyPatch) -> None:
    def counts_range(joint: Joint) -> tuple[int, int]:
        ends = joint.limits.lower / joint.units_per_count, joint.limits.upper / joint.units_per_count
        return math.floor(min(ends)) + joint.zero_counts, math.ceil(max(ends)) + joint.zero_counts

    patch.setattr(Joint, "counts_range", counts_range)


@detected_by("offsets carry the weight")
def joints_that_are_not_measured_lose_their_offset(patch: pytest.MonkeyPatch) -> None:
    update = JointOffset.update

    def wrong(offset: JointOffset, command: float, measured: float, *more: float) -> float:
        found = update(offset, command, measured, *more)
        offset.offset = 0.0 if math.isnan(measured) else found
        return offset.offset

    patch.setattr(JointOffset, "update", wrong)


@detected_by("limp joints are found")
def hot_servos_are_driven_again(patch: pytest.MonkeyPatch) -> None:
    forget = ServoFaults.forget

    def wrong(faults: ServoFaults) -> None:
        released = dict(faults._released)
        forget(faults)
        faults._released.update(released)

    patch.setattr(ServoFaults, "forget", wrong)


@detected_by("health is true")
def loads_have_the_sign_of_the_servo(patch: pytest.MonkeyPatch) -> None:
    measure = ServoStates._measure

    def wrong(states: ServoStates, joint: Joint, reading: ServoState, *more: Any) -> ServoHealth:
        return measure(states, joint, reading, *more)._replace(load=reading.load)

    patch.setattr(ServoStates, "_measure", wrong)

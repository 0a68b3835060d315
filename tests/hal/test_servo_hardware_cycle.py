"""Tests of the cycles of an active arm: goals, speeds, silent servos and deactivation."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drivers.driver_errors import PortLost
from drivers.servos import sts
from hal.lifecycle import LifecycleState
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.servo_faults import RESET_S
from hal.servos.servo_goals import GAINED_S
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_states import ServoStates
from hal.types import FloatArray, JointCommand
from sim_backend.mechanics.gears import Gears
from sim_backend.servos.sts.firmware import StsVariant
from tests.hal.bench import IDS, JOINTS, NAMES, PERIOD_S, Bench, at, joint_of
from tests.hal.faults import fault_texts

HERE = at(0.0, 0.0, JOINTS[2].position(1500))
"""Initial positions of the joints."""


def speeds(bench: Bench) -> list[int]:
    return [bench.held(i, sts.goal_velocity) for i in IDS]


def goals(bench: Bench) -> list[int]:
    return [bench.held(i, sts.goal_position) for i in IDS]


# Commands


def test_a_command_is_one_packet_with_every_goal() -> None:
    bench = Bench().active()
    sent = len(bench.port.sent)
    bench.hardware.write(JointCommand(at(0.1, 0.1, 0.02), PERIOD_S))
    (packet,) = bench.port.sent[sent:]
    assert (packet.code, packet.servo_id) == (0x83, 0xFE)
    assert goals(bench) == [joint.counts(p) for joint, p in zip(JOINTS, (0.1, 0.1, 0.02), strict=True)]


def test_joints_reach_commands_in_their_own_units() -> None:
    bench = Bench().active()
    position = HERE
    for _ in range(20):
        position = position + at(0.02, -0.02, 0.0005)
        bench.cycle(position)
    for _ in range(5):
        state = bench.cycle(position)
    np.testing.assert_allclose(state.position, position, atol=0.01)
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.1)


def test_velocity_has_the_joints_sign() -> None:
    bench = Bench().active()
    position = HERE
    for _ in range(6):
        position = position + at(0.05, 0.05, 0.001)
        state = bench.cycle(position)
    np.testing.assert_allclose(state.velocity[:2], 1.0, rtol=0.3)
    assert 0.01 < state.velocity[2] < 0.04


def test_effort_has_the_joints_sign_and_unit() -> None:
    bench = Bench().active()
    bench.plant.load_nm[:] = [-0.5, 0.5, -0.5]  # torques on the shafts; the servo of the elbow is mirrored
    for _ in range(10):
        state = bench.cycle(HERE)
    np.testing.assert_allclose(state.effort, [0.5, 0.5, 0.5 / 0.03], rtol=0.2)


@pytest.mark.parametrize("wanted", [math.nan, -math.nan])
def test_a_command_that_is_not_finite_reaches_no_servo(wanted: float) -> None:
    bench = Bench().active()
    sent, before = len(bench.port.sent), goals(bench)
    with pytest.raises(ValueError):
        bench.hardware.write(JointCommand(at(0.1, wanted, 0.02), PERIOD_S))
    assert len(bench.port.sent) == sent
    assert goals(bench) == before


@pytest.mark.parametrize("wanted", [math.inf, -math.inf, 1e300, 100.0, -100.0])
def test_even_without_a_gate_no_goal_is_outside_the_limits_or_out_of_reach(wanted: float) -> None:
    """The goals are limited again after the safety gate."""
    bench = Bench().active()
    last = goals(bench)
    for _ in range(30):
        bench.hardware.write(JointCommand(np.full(3, wanted), PERIOD_S))
        for joint, before, now in zip(JOINTS, last, goals(bench), strict=True):
            lowest, highest = joint.counts_range()
            assert lowest <= now <= highest
            assert abs(now - before) <= joint.limits.velocity * PERIOD_S / abs(joint.units_per_count) + 1
        last = goals(bench)
        bench.wait()
    ends = [joint.counts_range()[(wanted > 0) == (joint.sign > 0)] for joint in JOINTS]
    assert last == ends


def test_the_goal_of_a_blocked_joint_is_not_further_ahead_than_needed() -> None:
    """If the goal were farther ahead, the joint would jump when it is no longer blocked. Other joints are not
    affected."""
    bench = Bench().active()
    wanted = at(-1.5, 1.0, 0.05)
    stuck = JOINTS[0]
    assert stuck.compliance is not None
    gives, speed = stuck.compliance, stuck.limits.acceleration * GAINED_S  # the joint is at rest
    lags = gives.lag_s * speed + speed**2 / (2.0 * gives.profile_acceleration)
    lead = stuck.full_effort / gives.stiffness + lags + stuck.limits.velocity * PERIOD_S
    free = Gears(0.02, 0.1, 0.05, 0.0)
    bench.plant.fit([replace(free, coulomb_nm=100.0), None, None])
    for _ in range(40):
        bench.cycle(wanted)
    commanded = [joint.position(goal) for joint, goal in zip(JOINTS, goals(bench), strict=True)]
    assert commanded[0] == pytest.approx(-lead, abs=0.03)
    assert commanded[1:] == pytest.approx(wanted[1:], abs=0.002)
    bench.plant.fit([free, None, None])
    for _ in range(40):
        last = goals(bench)
        state = bench.cycle(wanted)
        assert abs(goals(bench)[0] - last[0]) <= stuck.limits.velocity * PERIOD_S / abs(stuck.units_per_count) + 1
    assert state.position[0] == pytest.approx(wanted[0], abs=0.02), "a free joint reaches its command"


@pytest.mark.parametrize("commands", [1, 4])
def test_one_false_measurement_moves_no_goal(commands: int) -> None:
    """A measurement is not used twice: a component whose bus is lost is commanded but not read in the next cycle."""
    bench = Bench().active()
    for _ in range(6):
        bench.cycle(HERE)
    before = goals(bench)
    bench.place((3500, 2048, 2048))
    bench.hardware.read()
    for _ in range(commands):
        bench.hardware.write(JointCommand(HERE, PERIOD_S))
    assert goals(bench) == before


class Lifting(GravityCompensation):
    """Compensation that adds a given offset to the shoulder's next goal once, and records the calls of its update."""

    def __init__(self) -> None:
        super().__init__(JOINTS, None)
        self.updates: list[tuple[JointCommand, dict[str, int]]] = []

    def update(self, command: JointCommand, states: ServoStates) -> None:
        self.updates.append((command, dict(states.measured)))
        self.offsets = at(0.05, 0.0, 0.0)


def test_the_offset_computed_for_one_command_is_added_to_the_next() -> None:
    bench, lifting = Bench(), Lifting()
    bench.hardware = ServoHardware("arm", JOINTS, bench.open_bus, bench.clock, lifting)
    bench.active()
    first, second = JointCommand(HERE, PERIOD_S), JointCommand(HERE + at(0.1, 0.1, 0.0), PERIOD_S)
    bench.hardware.write(first)
    assert goals(bench) == [joint.counts(position) for joint, position in zip(JOINTS, HERE, strict=True)]
    bench.hardware.write(second)
    wanted = HERE + at(0.15, 0.1, 0.0)
    assert goals(bench) == [joint.counts(position) for joint, position in zip(JOINTS, wanted, strict=True)]
    measured = dict(zip(NAMES, (2048, 2000, 1500), strict=True))
    assert lifting.updates == [(first, measured), (second, measured)]


def test_a_command_for_another_number_of_joints_is_refused() -> None:
    bench = Bench().active()
    with pytest.raises(ValueError):
        bench.hardware.write(JointCommand(at(0.1, 0.1), PERIOD_S))


# Interpolation


@pytest.mark.parametrize("period_s", [0.05, 0.02, 0.1])
def test_a_servo_moves_during_the_whole_period(period_s: float) -> None:
    bench = Bench().active()
    bench.hardware.write(JointCommand(HERE + at(0.06, -0.03, 0.0), period_s))
    for way, speed in zip((39, 20, 0), speeds(bench), strict=True):
        assert way / period_s < speed <= way / period_s * 1.1 + 105


def test_a_goal_at_rest_never_has_unlimited_speed() -> None:
    bench = Bench().active()
    bench.hardware.write(JointCommand(HERE, PERIOD_S))
    assert all(0 < speed <= 100 for speed in speeds(bench))


def test_the_goal_speed_decays_as_slowly_as_the_servo_follows() -> None:
    """If the goal speed decayed faster, a servo that lags behind its goals would move the remaining distance slowly."""
    bench = Bench().active()
    bench.cycle(HERE + at(0.06, 0.0, 0.0))
    fast = speeds(bench)[0]
    bench.cycle(HERE + at(0.07, 0.0, 0.0))
    assert 0.6 * fast < speeds(bench)[0] < 0.9 * fast
    for _ in range(10):
        bench.cycle(HERE + at(0.07, 0.0, 0.0))
    assert speeds(bench)[0] < fast / 5


# Silence


@pytest.mark.parametrize(("servo_id", "name"), list(zip(IDS, NAMES, strict=True)))
def test_a_silent_servo_is_reported_while_the_others_continue(
    servo_id: int, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench().active()
    before = bench.wait()
    bench.servos.faults.silence(servo_id)
    position = HERE
    for _ in range(4):
        position = position + at(0.05, 0.05, 0.001)
        state = bench.cycle(position)
    assert fault_texts(state) == {name: f"{name}: servo {servo_id} does not respond"}
    moved = np.abs(state.position - before.position) > [0.05, 0.05, 0.001]
    assert list(moved) == [joint.servo_id != servo_id for joint in JOINTS]
    assert set(state.health) == set(NAMES)
    assert [record.getMessage() for record in caplog.records] == [f"{name}: servo {servo_id} does not respond"], (
        "logged once per episode, not once per cycle"
    )


def test_the_counters_of_a_silent_servo_are_updated() -> None:
    bench = Bench().active()
    bench.wait()
    bench.servos.faults.silence(1)
    counted = [bench.wait().health["shoulder"].counters for _ in range(12)]
    silent = [account.silent for account in counted if account is not None]
    assert silent[0] < silent[1] and counted[-1] is not None and counted[-1].skipped > 0


def test_a_corrupt_reply_is_a_fault_of_one_cycle() -> None:
    bench = Bench().active()
    bench.servos.faults.corrupt_next(2, replies=3)
    assert fault_texts(bench.wait()) == {"elbow": "elbow: servo 2 replied with a wrong checksum"}
    assert bench.wait().faults == {}


def test_a_servo_that_answers_again_with_torque_has_no_fault(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    bench.wait()
    bench.servos.faults.restore(2)
    assert bench.wait().faults == {}
    assert [r.getMessage() for r in caplog.records if r.levelname == "WARNING"] == ["elbow: servo 2 responds again"]


def test_a_servo_that_answers_again_without_torque_keeps_its_fault(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    bench.wait()
    bench.wait()
    bench.servos.servo(2).power_cycle()
    bench.servos.faults.restore(2)
    bench.wait()
    for _ in range(5):
        state = bench.cycle(HERE)
        assert fault_texts(state) == {
            "elbow": "elbow: servo 2 returned with its torque disabled (power dip?): activate again",
        }
    messages = [r.getMessage() for r in caplog.records if "returned with its torque disabled" in r.getMessage()]
    assert messages == ["elbow: servo 2 returned with its torque disabled (power dip?): activate again"]
    assert bench.torque() == [1, 7], "only activate enables torque"
    bench.hardware.deactivate(relax=False)
    bench.hardware.activate()
    assert bench.torque() == list(IDS)
    assert bench.wait().faults == {}


def comes_back(bench: Bench, position: FloatArray) -> None:
    """Run cycles until no servo is missing. The next goals are sent to all servos."""
    for _ in range(20):
        if not bench.cycle(position).faults:
            return
    pytest.fail("the servo was not taken back within a second")


def commanded_ids(bench: Bench) -> list[int]:
    """Return the IDs of the servos that receive a goal with the next command."""
    before = len(bench.port.sent)
    bench.hardware.write(JointCommand(HERE, PERIOD_S))
    (packet,) = bench.port.sent[before:]
    return list(packet.parameters[2 :: packet.parameters[1] + 1])


@pytest.mark.parametrize("period_s", [0.05, 0.02, 0.009, 0.004])
def test_a_servo_that_may_have_been_reset_gets_no_goal(period_s: float) -> None:
    """A goal would enable the torque of the servo. In a fast loop, however, goals must not be withheld after every lost
    reply."""
    bench = Bench().active()
    heard_s = bench.wait().stamp_s
    bench.servos.faults.silence(2)
    while bench.clock.now() < heard_s + 2.0 * RESET_S:
        bench.clock.sleep_until(bench.clock.now() + period_s)
        bench.hardware.request(bench.clock.now() + 0.002)
        silent_s = bench.hardware.read().stamp_s - heard_s
        if abs(silent_s - RESET_S) > 0.002:
            assert commanded_ids(bench) == ([1, 7] if silent_s > RESET_S else list(IDS)), silent_s


def test_a_limp_servo_gets_no_goal_after_a_single_lost_reply() -> None:
    """A goal would enable the torque of the servo."""
    bench = Bench().active()
    bench.servos.faults.silence(2)
    bench.wait()
    bench.servos.servo(2).power_cycle()
    bench.servos.faults.restore(2)
    assert bench.wait().faults["elbow"].kind == "no_torque"
    assert commanded_ids(bench) == [1, 7]


def test_a_servo_gets_goals_again_after_its_activation() -> None:
    bench = Bench().active()
    bench.servos.faults.silence(2)
    for _ in range(3):
        bench.wait()
    bench.hardware.deactivate(relax=False)
    bench.servos.faults.restore(2)
    bench.hardware.activate()
    assert commanded_ids(bench) == list(IDS)


def test_a_servo_that_answers_again_far_away_does_not_jump() -> None:
    """The servo has received no goals in the meantime. The next goal of the servo differs from its last goal by at most
    the travel of one period."""
    bench = Bench().active()
    bench.servos.faults.silence(1)
    position = HERE
    for _ in range(10):
        position = position + at(0.05, 0.0, 0.0)
        bench.cycle(position)
    bench.servos.faults.restore(1)
    begin = bench.measured(1)
    comes_back(bench, position)
    bench.cycle(position)
    reach = JOINTS[0].limits.velocity * PERIOD_S / JOINTS[0].units_per_count
    assert 0 < bench.held(1, sts.goal_position) - begin < 3.0 * reach
    assert bench.measured(1) - begin < 2.0 * reach


def missed_goals() -> Bench:
    """Make the shoulder silent for ten cycles. The next goal of the servo equals its last goal."""
    bench = Bench().active()
    bench.servos.faults.silence(1)
    for share in np.linspace(0.05, 0.5, 10):
        bench.cycle(HERE + at(share, 0.0, 0.0))
    bench.servos.faults.restore(1)
    comes_back(bench, HERE + at(0.5, 0.0, 0.0))
    bench.cycle(HERE + at(0.5, 0.0, 0.0))
    return bench


def test_a_servo_that_answers_again_catches_up_in_half_a_second() -> None:
    """A goal at rest needs no speed, but the servo must still cover its distance to the goal. The servo must neither
    creep nor jump."""
    bench = missed_goals()
    bound = JOINTS[0].limits.velocity / JOINTS[0].units_per_count
    for _ in range(40):
        before = bench.measured(1)
        state = bench.cycle(HERE + at(0.5, 0.0, 0.0))
        assert abs(bench.measured(1) - before) <= bound * PERIOD_S * 1.1
        if abs(state.position[0] - 0.5) > 0.1:
            # The goal speed is slightly higher than needed.
            velocity = bench.held(1, sts.goal_velocity)
            furthest = math.ceil(bound * PERIOD_S) / PERIOD_S
            assert 0 < velocity <= furthest * 1.1 + 101
    assert state.position[0] == pytest.approx(0.5, abs=0.03)


def test_a_servo_that_was_blocked_does_not_jump() -> None:
    """The servo replies in every cycle, so only its position shows that it lags behind its goals."""
    bench = Bench().active()
    for share in np.linspace(0.05, 0.5, 10):
        bench.place((2048, 2000, 1500))
        bench.cycle(HERE + at(share, 0.0, 0.0))
    bench.place((2048, 2000, 1500))
    bench.wait()
    bench.place((2048, 2000, 1500))
    bench.hardware.write(JointCommand(HERE + at(0.5, 0.0, 0.0), PERIOD_S))
    behind = JOINTS[0].counts(0.5) - 2048
    assert behind / 0.7 < bench.held(1, sts.goal_velocity) < behind / 0.3


def test_catching_up_respects_the_velocity_limit() -> None:
    slow = [replace(JOINTS[0], limits=replace(JOINTS[0].limits, velocity=0.2)), *JOINTS[1:]]
    bench = Bench(joints=slow).active()
    bench.place((2048 - 600, 2000, 1500))
    bench.cycle(HERE)
    bench.place((2048 - 600, 2000, 1500))
    bench.hardware.read()
    bench.hardware.write(JointCommand(HERE, PERIOD_S))
    assert bench.held(1, sts.goal_velocity) == round(0.2 / JOINTS[0].units_per_count)


def test_a_dead_bus_reports_every_joint() -> None:
    bench = Bench().active()
    for servo_id in IDS:
        bench.servos.faults.silence(servo_id)
    before = bench.wait()
    state = bench.wait()
    assert set(state.faults) == set(NAMES)
    np.testing.assert_array_equal(state.position, before.position)


def test_in_an_inactive_component_a_fault_ends_with_the_first_answer() -> None:
    bench = Bench().configured()
    bench.servos.faults.silence(2)
    assert set(bench.wait().faults) == {"elbow"}
    bench.servos.faults.restore(2)
    assert bench.wait().faults == {}


def test_in_an_inactive_component_each_silence_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().configured()
    for _ in range(2):
        bench.servos.faults.silence(2)
        bench.wait()
        bench.servos.faults.restore(2)
        assert bench.wait().faults == {}
    assert caplog.text.count("servo 2 does not respond") == 2


def test_alarms_are_part_of_a_joints_health() -> None:
    bench = Bench().active()
    bench.servos.servo(2).memory.put(sts.max_temperature, 1)
    bench.wait()
    state = bench.wait()  # the temperature alarm is reported after 51 ms
    assert state.health["elbow"].alarms == ("temperature",)
    assert state.health["shoulder"].alarms == ()


# Deactivation


def test_deactivation_without_relax_holds() -> None:
    bench = Bench().active()
    bench.plant.load_nm[0] = 0.5
    assert bench.hardware.deactivate(relax=False) == []
    assert bench.hardware.state is LifecycleState.INACTIVE
    assert bench.torque() == list(IDS)
    for _ in range(20):
        state = bench.wait()
    np.testing.assert_allclose(state.position, HERE, atol=0.03)


def test_relaxing_releases_all_servos() -> None:
    bench = Bench().active()
    assert bench.hardware.deactivate(relax=True) == []
    assert bench.torque() == []


@pytest.mark.parametrize("dead", [(1,), (2,), (7,), (1, 7)])
def test_relaxing_with_dead_servos_releases_the_others_and_reports_them(dead: tuple[int, ...]) -> None:
    bench = Bench().active()
    for servo_id in dead:
        bench.servos.faults.silence(servo_id)
    problems = bench.hardware.deactivate(relax=True)
    assert bench.torque() == list(dead)
    assert len(problems) == len(dead)
    for servo_id, problem in zip(dead, problems, strict=True):
        assert f"servo {servo_id}: does not respond" in problem
    assert bench.hardware.state is LifecycleState.INACTIVE


# Lost ports


def test_a_lost_port_is_raised_by_the_cycle() -> None:
    bench = Bench().active()
    bench.port.port.unplug()
    for _ in range(2):
        with pytest.raises(PortLost):
            bench.hardware.read()
        with pytest.raises(PortLost):
            bench.hardware.write(JointCommand(HERE, PERIOD_S))


def test_deactivation_reports_a_lost_port_and_cleanup_works() -> None:
    bench = Bench().active()
    bench.port.port.unplug()
    (problem,) = bench.hardware.deactivate(relax=True)
    assert "unplugged" in problem
    assert bench.hardware.state is LifecycleState.INACTIVE
    bench.hardware.cleanup()
    assert bench.hardware.state is LifecycleState.UNCONFIGURED


def test_a_port_lost_during_relaxing_is_reported() -> None:
    bench = Bench().active()
    sent = len(bench.port.sent)
    bench.port.before_write = lambda number, _: bench.port.port.unplug() if number == sent + 1 else None
    (problem,) = bench.hardware.deactivate(relax=True)
    assert "unplugged" in problem
    assert bench.torque() == []  # the first packet has already reached all servos


# Torque lost without a report


def cycles_until_fault(bench: Bench, name: str) -> int:
    """Return the number of cycles until a joint has a fault."""
    for number in range(1, 40):
        if name in bench.cycle(HERE).faults:
            return number
    pytest.fail(f"{name} never had a fault")


@pytest.mark.parametrize("servo_id", IDS)
@pytest.mark.parametrize("goal_write_energises", [False, True])
def test_a_reset_between_two_readings_is_detected_within_half_a_second(
    servo_id: int, goal_write_energises: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """The servo has answered all the time. If a goal has enabled the servo's torque again, its torque limit is still
    lost."""
    bench = Bench(variant=StsVariant(goal_write_energises)).active()
    bench.cycle(HERE)
    bench.servos.servo(servo_id).power_cycle()
    joint = joint_of(servo_id).name
    assert cycles_until_fault(bench, joint) * PERIOD_S <= 0.5
    text = f"{joint}: servo {servo_id} has lost its torque (current protection, power dip?): activate again"
    for _ in range(5):
        assert fault_texts(bench.cycle(HERE)) == {joint: text}
        assert commanded_ids(bench) == [i for i in IDS if i != servo_id]
    assert caplog.text.count("has lost its torque") == 1
    bench.hardware.deactivate(relax=False)
    bench.hardware.activate()
    assert bench.cycle(HERE).faults == {}
    assert bench.torque() == list(IDS)


def test_a_normal_servo_is_never_reported_as_limp() -> None:
    bench = Bench().active()
    for _ in range(60):
        assert bench.cycle(HERE).faults == {}


def test_an_arm_without_commands_is_also_checked() -> None:
    bench = Bench().active()
    bench.servos.servo(2).memory.put(sts.torque_enable, 0)
    assert any("elbow" in bench.wait().faults for _ in range(10))


def overheat(bench: Bench) -> None:
    bench.servos.servo(2).firmware.temperature_c = 90.0


def draw_too_much(bench: Bench) -> None:
    """Set the current limit of a servo below the current for a load of 0.5 N m."""
    bench.servos.servo(2).memory.put(sts.protection_current, 1)
    bench.servos.servo(2).memory.put(sts.overcurrent_time, 1)
    bench.plant.load_nm[1] = 0.5


@pytest.mark.parametrize(("alarm", "cause"), [("current", draw_too_much), ("temperature", overheat)])
def test_a_servo_that_released_its_torque_gets_no_goal_until_activation(
    alarm: str, cause: Callable[[Bench], None]
) -> None:
    """A goal would enable the torque again, or would move the servo as soon as it has cooled down."""
    bench = Bench().active()
    bench.cycle(HERE)
    cause(bench)
    for _ in range(5):
        bench.wait()
    assert bench.wait().faults["elbow"].text == f"elbow: servo 2 released its torque ({alarm} alarm): activate again"
    assert (bench.torque() == [1, 7]) is (alarm == "current")
    bench.plant.load_nm[1] = 0.0
    bench.servos.servo(2).firmware.temperature_c = 30.0
    bench.place((2048, 2000, 1500))
    for _ in range(15):
        assert commanded_ids(bench) == [1, 7]
        assert bench.wait().faults["elbow"].kind == "no_torque"
    bench.servos.faults.silence(2)
    assert bench.wait().faults["elbow"].kind == "silent"
    bench.servos.faults.restore(2)
    for _ in range(15):
        assert bench.wait().faults["elbow"].text.endswith("activate again"), "it responds again but is still limp"
        assert commanded_ids(bench) == [1, 7]
    bench.hardware.deactivate(relax=False)
    bench.hardware.activate()
    assert bench.cycle(HERE).faults == {}


@pytest.mark.parametrize("alarm", ["voltage", "overload"])
def test_a_servo_with_a_harmless_alarm_continues(alarm: str) -> None:
    """A voltage alarm is only reported, and an overload alarm leaves part of the torque."""
    bench = Bench().active()
    memory = bench.servos.servo(2).memory
    if alarm == "voltage":
        memory.put(sts.min_voltage, 130)
    else:  # an overload is any drive that does not move the shaft within 10 ms
        memory.put(sts.overload_torque, 0)
        memory.put(sts.protective_torque, 0)
        memory.put(sts.protection_time, 1)
        bench.plant.load_nm[1] = 0.3
    for _ in range(3):
        state = bench.wait()
    assert state.health["elbow"].alarms == (alarm,)
    assert state.faults == {}
    assert commanded_ids(bench) == list(IDS)

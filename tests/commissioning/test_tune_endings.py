"""``tune`` leaves the arm as configured after success, an interruption, a lost servo or port, or an obstacle."""

from collections.abc import Sequence

import pytest

from commissioning.slow_arm import StoppedError
from commissioning.tune.gains import TuneError
from commissioning.tune.report import tune
from commissioning.tune.tuner import Ending, Tuner
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, PortLost
from drivers.servos import sts, x
from hal.joint import Joint
from servoloop.stack.hardware import servo_bus
from tests.commissioning.patient import Patient
from tests.commissioning.tuned import HELD, PARK, RELEASED, TuneBench


@pytest.mark.parametrize("ending", [RELEASED, HELD], ids=["released", "held"])
def test_the_arm_is_left_as_the_robot_file_requires(ending: Ending) -> None:
    bench = TuneBench()
    report = tune(bench.tuner(ending=ending))
    assert bench.torque == [not ending.relax] * 3
    if ending.relax:
        assert bench.positions[1] == pytest.approx(PARK["elbow"], abs=0.05)
    else:
        assert bench.positions[0] == pytest.approx(report.before.plan.start, abs=0.1)


def test_a_held_arm_is_released_only_for_the_write() -> None:
    bench = TuneBench({sts.position_p: 16})
    tune(bench.tuner(ending=HELD), write={"P": 24})
    assert bench.torque == [True] * 3


def test_gains_are_not_written_without_a_park_pose() -> None:
    bench = TuneBench({sts.torque_enable: 1})
    held = bench.tuner(ending=Ending(relax=False))
    assert len(held.held) == 3
    with pytest.raises(TuneError, match="no park pose"):
        tune(held, write={"P": 24})
    assert bench.torque == [True] * 3


def test_stopping_parks_and_releases_the_arm() -> None:
    bench = TuneBench()
    report_at_s = bench.clock.now() + 6.0
    with pytest.raises(StoppedError, match="stopped: the arm's torque is disabled"):
        tune(bench.tuner(stopped=lambda: bench.clock.now() > report_at_s))
    assert bench.torque == [False] * 3
    assert bench.positions[1] == pytest.approx(PARK["elbow"], abs=0.05)


def test_stopping_before_the_write_writes_nothing() -> None:
    bench = TuneBench({sts.position_p: 16})
    before = bench.saved
    with pytest.raises(StoppedError, match="nothing was written"):
        bench.tuner(stopped=lambda: True).write({"P": 24})
    assert bench.saved == before


@pytest.mark.parametrize("ending", [RELEASED, HELD], ids=["released", "held"])
def test_a_failed_servo_is_named_and_the_others_end_as_configured(ending: Ending) -> None:
    bench = TuneBench()
    end_s = bench.clock.now() + 5.0

    def silence(data: bytes) -> None:
        if bench.clock.now() > end_s:
            bench.line.faults.silence(2)

    bench.before = silence
    with pytest.raises(DriverError, match=r"servo 2|elbow"):
        tune(bench.tuner(ending=ending))
    assert [bench.torque[0], bench.torque[2]] == [not ending.relax] * 2


def test_an_unplugged_port_is_reported() -> None:
    bench = TuneBench()
    end_s = bench.clock.now() + 5.0

    def pull(data: bytes) -> None:
        if bench.clock.now() > end_s and bench.port is not None:
            bench.port.unplug()

    bench.before = pull
    with pytest.raises(PortLost, match="unplugged") as lost:
        tune(bench.tuner())
    assert lost.value.__notes__[0].startswith("torque may still be on: ")


def test_written_gains_are_listed_if_the_second_measurement_fails() -> None:
    bench = TuneBench()
    written = False

    def silence(data: bytes) -> None:
        nonlocal written
        written = written or bench.memories[0].get(sts.position_p) == 24
        if written and all(bench.torque):
            bench.line.faults.silence(7)

    bench.before = silence
    with pytest.raises(DriverError) as caught:
        tune(bench.tuner(), write={"P": 24})
    held, written_to = caught.value.__notes__
    assert held.startswith("torque may still be on: servo 7: does not respond")
    assert written_to == "already written to servo 1: P changed from 32 to 24"


def test_a_joint_too_weak_for_its_load_is_reported_and_released() -> None:
    bench = TuneBench(load_nm=5.0)
    with pytest.raises(
        DriverError, match=r"shoulder.* (is not following its commands|reports an alarm|has let go|released its torque)"
    ):
        tune(bench.tuner())
    assert bench.torque == [False] * 3


def test_an_obstacle_is_met_in_the_slow_pass() -> None:
    bench = TuneBench()
    wall = bench.plant.joints.position[0] + 0.38
    fastest_there = 0.0

    def stand_in_the_way(data: bytes) -> None:
        nonlocal fastest_there
        if bench.plant.joints.position[0] > wall:
            fastest_there = max(fastest_there, float(bench.plant.joints.velocity[0]))
            bench.plant.joints.position[0], bench.plant.joints.velocity[0] = wall, 0.0

    bench.before = stand_in_the_way
    with pytest.raises(TuneError, match=r"shoulder \(servo 1\) should have moved by \+0\.150, but it moved by \+0\.0"):
        tune(bench.tuner())
    assert 0.0 < fastest_there < 0.6
    assert bench.torque == [False] * 3


def test_an_unknown_joint_and_a_silent_servo_are_named() -> None:
    bench = TuneBench()
    with pytest.raises(TuneError, match="no joint wrist: choose one of shoulder, elbow, finger"):
        bench.tuner("wrist")
    bench.line.faults.silence(2)
    with pytest.raises(TuneError, match="elbow: servo 2"):
        bench.tuner()


def test_an_exception_lets_the_arm_sink() -> None:
    bench = TuneBench()
    end_s = bench.clock.now() + 5.0

    def fail(data: bytes) -> None:
        if bench.clock.now() > end_s:
            bench.before = lambda data: None
            raise ZeroDivisionError

    bench.before = fail
    with pytest.raises(ZeroDivisionError):
        tune(bench.tuner())
    assert bench.torque == [False] * 3


def test_an_arm_on_two_buses_is_held_and_released() -> None:
    patient = Patient("robot_arm_two_buses.yaml")
    file = patient.robot.file
    seen: list[list[bool]] = []

    def opened(joints: Sequence[Joint]) -> dict[str, Bus]:
        return {
            name: servo_bus(file, patient.open(f"x-{name}", line.baud), patient.clock, name)
            for name, line in file.lines().items()
        }

    def driven() -> list[bool]:
        arm, hand = (patient.lines[name].servos for name in ("arm", "hand"))
        return [
            *(one.memory.get(sts.torque_enable) == 1 for one in arm),
            *(one.memory.get(x.torque_enable) == 1 for one in hand),
        ]

    def never() -> bool:
        seen.append(driven())
        return False

    tune(Tuner(patient.robot.joints, "hand_right_joint", opened, patient.clock, Ending(relax=True), never))
    limp, held = seen[:2], seen[2:]  # the first two calls precede the activation
    assert not any(map(any, limp)) and len(held) > 100 and all(map(all, held))
    assert not any(driven())

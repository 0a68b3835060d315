"""Shafts that are pushed or turned by hand over the seam of their encoders, outside the limits of their joints."""

import math

import pytest

from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from drivers.servos import sts
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LeaderArm
from hal.servos.servo_faults import RESET_S
from hal.types import JointLimits
from tests.hal.bench import PERIOD_S, Bench, at

ROLL = Joint("roll", 1, sts.STS3215, JointLimits(-3.14, 3.14, 4.0, 12.0, 120.0))


def shaft(bench: Bench) -> float:
    """Return the position of the first shaft with its turns, in counts."""
    return float(bench.plant.joints.position[0]) / math.tau * 4096


@pytest.mark.parametrize(("start", "limit", "load_nm"), [(4060, 3.14, 1.5), (36, -3.14, -1.5)])
@pytest.mark.parametrize("silent", [0, 2, 6])
def test_the_goal_of_a_joint_pushed_over_the_seam_does_not_move(
    start: int, limit: float, load_nm: float, silent: int
) -> None:
    """The servo may be silent in the cycles in which the joint crosses the seam."""
    bench = Bench(counts=[start], joints=(ROLL,)).active()
    for _ in range(20):
        bench.cycle(at(limit))
    goal, before = bench.held(1, sts.goal_position), shaft(bench)
    bench.plant.load_nm[0] = load_nm
    if silent:
        bench.servos.faults.silence(1)
        for _ in range(silent):
            bench.cycle(at(limit))
        bench.servos.faults.restore(1)
    pushed = [bench.cycle(at(limit)) for _ in range(30)]
    assert abs(shaft(bench) - 2048) > 2048 + 20, "the shaft is beyond the seam"
    known = [state.position[0] for state in pushed if not state.faults]
    assert len(known) > 25 and max(abs(position - limit) for position in known) < 0.3
    bench.plant.load_nm[0] = 0.0
    for _ in range(20):
        bench.cycle(at(limit))
        assert bench.held(1, sts.goal_position) == goal
    assert shaft(bench) == pytest.approx(before, abs=20)


def test_a_joint_that_is_thrown_over_the_seam_and_back_is_believed_where_it_is() -> None:
    """The joint crosses the seam too fast to be followed, and returns slowly."""
    bench = Bench(counts=[300], joints=(ROLL,)).active()
    here = at(ROLL.position(300))
    bench.cycle(here)
    bench.plant.load_nm[0] = -40.0
    while shaft(bench) > -150.0:
        bench.cycle(here)
    bench.plant.load_nm[0] = 0.0
    for _ in range(40):
        state = bench.cycle(here)
    assert state.position[0] == pytest.approx(here[0], abs=0.1)
    assert bench.held(1, sts.goal_position) == 300


def test_a_leader_that_is_turned_by_one_turn_is_where_it_was() -> None:
    bench = Bench(counts=[2048], joints=(ROLL,))
    leader = LeaderArm((ROLL,), bench.open_bus, bench.clock)
    bench.hardware = leader
    leader.configure()
    for counts in (*range(2048, 2048 + 4096, 64), *[2048 + 4096] * 3):
        bench.place([counts])
        state = bench.wait()
    assert state.position[0] == pytest.approx(0.0, abs=0.01) and state.faults == {}


@pytest.mark.parametrize("end", [5096, -3096])
def test_a_joint_that_has_lost_its_torque_is_believed_within_a_single_turn(end: int) -> None:
    """The joint loses its torque while its component is active, and is turned by hand over the seam."""
    bench = Bench(counts=[1000], joints=(ROLL,)).active()
    here = at(ROLL.position(1000))
    for _ in range(20):
        bench.cycle(here)
    bench.servos.faults.silence(1)
    for _ in range(round(2 * RESET_S / PERIOD_S)):
        bench.cycle(here)
    bench.servos.servo(1).power_cycle()
    bench.servos.faults.restore(1)
    step = 64 if end > 1000 else -64
    for counts in (*range(1000, end, step), *[end] * 3):
        bench.place([counts])
        state = bench.cycle(here)
    assert state.faults["roll"].kind == "no_torque"
    assert state.position[0] == pytest.approx(here[0], abs=0.01)
    bench.hardware.reactivate()
    assert bench.torque() == [1]
    before = shaft(bench)
    for _ in range(40):
        bench.cycle(here)
        assert shaft(bench) == pytest.approx(before, abs=30)


@pytest.mark.parametrize("end", [4230, 3900 + 4096])
def test_a_joint_that_is_turned_over_the_seam_by_hand_holds_when_its_torque_is_enabled(end: int) -> None:
    bench = Bench(counts=[3900], joints=(ROLL,))
    components = ComponentSet([bench.hardware], bench.clock)
    limits = {"roll": ROLL.limits}
    loop = ControlLoop(components, ControllerManager(components, limits), limits, bench.clock, PERIOD_S)

    def run(cycles: int) -> None:
        for _ in range(cycles):
            loop.step()
            bench.clock.sleep_until(bench.clock.now() + PERIOD_S)

    configure_all(components)
    loop.activate()
    run(5)
    released = loop.component_transitions.ask("arm", LifecycleState.INACTIVE, relax=True)
    run(5)
    released.result()
    for counts in range(3900, end + 1, 30):
        bench.place([counts])
        run(1)
    before = shaft(bench)
    driven = loop.component_transitions.ask("arm", LifecycleState.ACTIVE)
    for _ in range(60):
        run(1)
        assert shaft(bench) == pytest.approx(before, abs=30)
    driven.result()


@pytest.mark.parametrize(("counts", "refused"), [(4030, False), (4040, False), (4090, True), (4100, True), (70, False)])
def test_a_limp_joint_that_may_be_beyond_either_limit_gets_no_torque(counts: int, refused: bool) -> None:
    """Its limits of 3.05 rad are at 60 and at 4036 counts. The encoder cannot tell beyond which limit the joint is."""
    joint = Joint("joint6", 1, sts.STS3215, JointLimits(-3.05, 3.05, 4.0, 12.0, 120.0))
    bench = Bench(counts=[counts], joints=(joint,)).configured()
    if refused:
        with pytest.raises(ActivationError, match=r"upper limit 3.05 or .* lower limit -3.05\. Move the joint"):
            bench.hardware.activate()
        assert bench.torque() == []
    else:
        bench.hardware.activate()
        assert bench.torque() == [1]
        assert bench.held(1, sts.goal_position) == counts

"""Test components that are lost or change their state while the other components continue."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from controller.component_transitions import ComponentTransition, TransitionRules
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from controller.manager.requests import ENDED
from controller.manager.switch import SwitchRequest
from controller.manager_errors import SwitchError
from controller.shutdown import shut_down
from drivers.driver_errors import PortLost, PortMissing
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.hal_errors import ActivationError, LifecycleError, PartLost
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointCommand, JointFault, JointLimits, JointState
from sim_backend.clock import SimulatedClock
from tests.controller.test_loop import Puppet
from tests.hal.failing_mock import FailingMock
from tests.hal.faults import fault_texts

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = LifecycleState
PERIOD_S = 0.05
LIMIT = JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)
GONE = "/dev/hand is gone"
SPEED_RAD_S = 2.0


class Breakable(FailingMock):
    """Mock hardware that also records its commands and the way in which it was deactivated."""

    def __init__(self, name: str, joints: Sequence[str], clock: SimulatedClock) -> None:
        super().__init__(name, joints, clock)
        self.written: list[FloatArray] = []

    def deactivate(self, relax: bool) -> Sequence[str]:
        self.call("relax" if relax else "hold")
        return super().deactivate(relax)

    def read(self) -> JointState:
        self.call("read")
        return super().read()

    def write(self, command: JointCommand) -> None:
        self.written.append(command.values.copy())
        super().write(command)
        self.call("write")

    def changes(self) -> list[str]:
        """Return the recorded calls that change the life-cycle state."""
        return [call for call in self.calls if call not in ("read", "write")]


class Mover(Puppet):
    """Controller that moves one joint at a constant speed."""

    def __init__(self, joint: str) -> None:
        super().__init__()
        self.name = f"{joint}_controller"
        self.command_interfaces = (f"{joint}/position",)
        self.state_interfaces = self.command_interfaces
        self.speed = 0.0

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.command = self.command + self.speed * period_s


class Two:
    """An arm with two joints and a hand with one joint, each of them a component with its own controllers."""

    def __init__(
        self, keep_alive: bool = False, cycles_per_update: Sequence[int] = (1, 1), make: type[Mover] = Mover
    ) -> None:
        self.clock = SimulatedClock(5.0)
        self.arm = Breakable("arm", ("shoulder", "elbow"), self.clock)
        self.hand = Breakable("hand", ("finger",), self.clock)
        self.components = ComponentSet([self.arm, self.hand], self.clock, cycles_per_update)
        limits = dict.fromkeys(self.components.joints, LIMIT)
        self.manager = ControllerManager(self.components, limits)
        self.movers = {joint: make(joint) for joint in self.components.joints}
        for mover in self.movers.values():
            self.manager.registry.add(mover)
        self.background: list[Callable[[], None]] = []
        self.loop = ControlLoop(
            self.components,
            self.manager,
            limits,
            self.clock,
            PERIOD_S,
            TransitionRules(keep_alive, self.background.append),
        )
        self.states: list[JointState] = []
        self.loop.on_cycle = self.states.append

    def up(self) -> "Two":
        configure_all(self.components)
        self.loop.activate()
        return self

    def going(self) -> "Two":
        """Move all joints at constant speed."""
        self.up()
        for mover in self.movers.values():
            mover.speed = SPEED_RAD_S
        self.cycle(4)
        return self

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            self.loop.step()

    def work(self) -> None:
        """Do the background work, then run the cycle in which the components are controlled again."""
        for work in self.background:
            work()
        self.background.clear()
        self.cycle()

    def set(self, target: LifecycleState, name: str = "hand") -> ComponentTransition:
        """Request a state and run until the request completes."""
        change = self.loop.component_transitions.ask(name, target)
        for _ in range(40):
            self.cycle()
            self.work()
            if change.done:
                return change
        raise AssertionError("never decided")

    def active(self) -> list[str]:
        return [joint for joint, mover in self.movers.items() if self.manager.registry.state(mover.name) is ACTIVE]


def gentle(path: Sequence[FloatArray]) -> bool:
    """Return whether all joints braked within their acceleration limits."""
    velocity = np.diff(np.array(path), axis=0) / PERIOD_S
    return bool(np.abs(np.diff(velocity, axis=0)).max() <= LIMIT.acceleration * PERIOD_S * 1.2)


def test_components_are_concatenated_in_state_and_command() -> None:
    two = Two().going()
    assert two.components.command_interfaces == ("shoulder/position", "elbow/position", "finger/position")
    np.testing.assert_allclose(two.states[-1].position, 3 * SPEED_RAD_S * PERIOD_S)
    np.testing.assert_allclose(two.loop.command, 4 * SPEED_RAD_S * PERIOD_S)
    assert two.arm.written[-1].shape == (2,) and two.hand.written[-1].shape == (1,)


@pytest.mark.parametrize("kind", [PortLost, RuntimeError], ids=["lost", "a defect"])
@pytest.mark.parametrize("call", ["read", "write"])
def test_a_lost_component_deactivates_only_its_own_controllers_in_the_same_cycle(
    call: str, kind: type[Exception]
) -> None:
    two = Two().going()
    two.hand.failing[call] = error = kind(GONE)
    two.cycle()
    assert two.active() == ["shoulder", "elbow"]
    assert fault_texts(two.states[-1]) in ({}, {"finger": "hand is lost: /dev/hand is gone"})
    before = two.loop.command[:2]
    two.cycle(20)
    np.testing.assert_allclose(two.loop.command[:2], np.clip(before + 20 * SPEED_RAD_S * PERIOD_S, -2.0, 2.0))
    assert set(two.states[-1].faults) == {"finger"}
    assert two.hand.state is UNCONFIGURED
    assert two.hand.changes()[-1] == "cleanup"
    assert two.components.lost[0].error is error


@pytest.mark.parametrize("kind", [PortLost, PartLost])
def test_the_reachable_joints_of_a_lost_component_brake_within_their_limits(kind: type[PortLost]) -> None:
    two = Two().going()
    two.hand.failing["write"] = kind(GONE)
    two.cycle(30)
    assert len(two.hand.written) > 6
    assert gentle(two.hand.written)
    assert two.hand.written[-1] == pytest.approx(two.hand.written[-2], abs=0.01)


@pytest.mark.parametrize("state", [INACTIVE, UNCONFIGURED])
def test_a_component_that_leaves_the_active_state_on_its_own_is_lost(state: LifecycleState) -> None:
    two = Two().going()
    two.hand.state = state
    two.cycle()
    assert two.active() == ["shoulder", "elbow"]
    two.cycle(20)
    assert (two.hand.state, two.hand.changes()[-1]) == (UNCONFIGURED, "cleanup")
    assert str(two.components.lost[0].error) == f"it became {state.name.lower()} without a request"
    assert two.set(ACTIVE).result() is None
    two.cycle(3)
    assert two.components.lost == []


def test_the_loop_ends_when_the_last_component_is_lost() -> None:
    two = Two().up()
    two.hand.failing["read"] = PortLost(GONE)
    two.cycle(2)
    two.arm.failing["read"] = PortLost("/dev/arm is gone")
    with pytest.raises(PortLost, match="/dev/arm is gone"):
        two.cycle()
    assert two.arm.state is ACTIVE  # The shutdown must still be able to stop the arm.


def test_a_component_that_was_never_configured_does_not_keep_the_loop_alive() -> None:
    two = Two()
    configure_all(two.components, ["hand"])
    two.loop.activate()
    assert two.active() == ["shoulder", "elbow"]
    two.arm.failing["read"] = PortLost(GONE)
    with pytest.raises(PortLost):
        two.cycle()


def test_a_lost_component_resumes_at_its_measured_positions() -> None:
    two = Two(keep_alive=True).going()
    for hardware in (two.arm, two.hand):
        hardware.failing["read"] = PortLost(GONE)
    two.cycle(20)
    assert (two.arm.state, two.hand.state, two.active()) == (UNCONFIGURED, UNCONFIGURED, [])
    assert set(two.states[-1].faults) == {"shoulder", "elbow", "finger"}
    two.hand.failing.clear()
    two.hand._position[:] = -0.7  # The joint was moved by hand.
    written = len(two.hand.written)
    assert two.set(ACTIVE).result() is None
    assert two.hand.state is ACTIVE
    two.cycle(2)
    np.testing.assert_allclose(two.hand.written[written:], -0.7)
    assert two.loop.command[2] == pytest.approx(-0.7)
    assert set(two.states[-1].faults) == {"shoulder", "elbow"}
    assert two.components.lost == [two.components.components[0]]


def test_a_component_is_taken_over_after_one_more_reading() -> None:
    two = Two()
    two.arm._position[:], two.hand._position[:] = (1.5, 0.5), -0.7
    two.up().cycle()
    readings = two.hand.calls.count("read")
    two.loop.take_over(two.components.components[1], two.states[-1])
    assert two.hand.calls.count("read") == readings + 1 and two.loop.command[2] == -0.7


@pytest.mark.parametrize("faults", [{}, {"shoulder": JointFault("silent", "no reply")}])
def test_joints_that_are_not_taken_over_do_not_matter(faults: dict[str, JointFault]) -> None:
    two = Two()
    two.arm._position[:] = (0.0, 0.4)
    two.up().cycle()
    state = replace(two.states[-1], position=np.array([9.0, 0.4, 0.0]), faults=faults)
    part = replace(two.arm.read(), position=state.position[:2], faults=faults)
    two.arm.read = lambda: part  # type: ignore[method-assign]
    two.loop.take_over(two.components.components[0], state, ["elbow"])
    assert two.loop.command.tolist() == [0.0, 0.4, 0.0]


def test_all_joints_far_outside_their_limits_are_named() -> None:
    two = Two()
    two.arm._position[:] = (9.0, -8.0)
    with pytest.raises(ActivationError, match=r"activated: shoulder is at 9\.0000, [^;]*; elbow is at -8\.0000"):
        two.up()


class Reliever(Mover):
    """Controller whose relief lasts until another controller claims its joint."""

    def begin_relief(self, state: JointState, command: FloatArray) -> None:
        self.command = command

    def relieve(self, state: JointState, now_s: float, period_s: float) -> bool:
        return True


def test_a_component_that_returns_during_its_relief_stays_at_its_measured_positions() -> None:
    two = Two(keep_alive=True, make=Reliever).going()
    two.hand.failing["read"] = PortLost(GONE)
    two.cycle(20)
    two.hand.failing.clear()
    two.hand._position[:] = -0.7  # The joint was moved by hand.
    written = len(two.hand.written)
    assert two.set(ACTIVE).result() is None
    two.cycle(5)
    np.testing.assert_allclose(two.hand.written[written:], -0.7)


def test_a_component_whose_cleanup_fails_is_finalized() -> None:
    two = Two().up()
    two.hand.failing = {"read": PortLost(GONE), "cleanup": RuntimeError("a defect")}
    two.hand.cleanup = lambda: two.hand.call("cleanup")  # type: ignore[method-assign]
    two.cycle(2)
    assert two.components.components[1].state is FINALIZED
    written = len(two.hand.written)
    two.cycle(3)
    assert len(two.hand.written) == written
    with pytest.raises(Exception, match="hand is permanently finalized"):
        two.set(ACTIVE).result()


WAYS = {
    # start and target of the transition: expected calls and final state
    (UNCONFIGURED, UNCONFIGURED): ([], UNCONFIGURED),
    (UNCONFIGURED, INACTIVE): (["configure"], INACTIVE),
    (UNCONFIGURED, ACTIVE): (["configure", "activate"], ACTIVE),
    (UNCONFIGURED, FINALIZED): (["cleanup"], FINALIZED),
    (INACTIVE, UNCONFIGURED): (["cleanup"], UNCONFIGURED),
    (INACTIVE, INACTIVE): ([], INACTIVE),
    (INACTIVE, ACTIVE): (["activate"], ACTIVE),
    (INACTIVE, FINALIZED): (["cleanup"], FINALIZED),
    (ACTIVE, UNCONFIGURED): (["hold", "cleanup"], UNCONFIGURED),
    (ACTIVE, INACTIVE): (["hold"], INACTIVE),
    (ACTIVE, ACTIVE): ([], ACTIVE),
    (ACTIVE, FINALIZED): (["hold", "cleanup"], FINALIZED),
    (FINALIZED, FINALIZED): ([], FINALIZED),
}


@pytest.mark.parametrize(("begin", "target"), WAYS)
def test_each_transition_calls_the_right_steps(begin: LifecycleState, target: LifecycleState) -> None:
    two = Two().up()
    two.set(begin).result()
    two.hand.calls.clear()
    two.set(target).result()
    assert (two.hand.changes(), two.components.components[1].state) == WAYS[(begin, target)]
    assert two.active()[:2] == ["shoulder", "elbow"]


@pytest.mark.parametrize("target", [UNCONFIGURED, INACTIVE, ACTIVE])
def test_a_finalized_component_cannot_change_its_state(target: LifecycleState) -> None:
    two = Two().up()
    two.set(FINALIZED).result()
    with pytest.raises(Exception, match="hand is permanently finalized"):
        two.set(target).result()


def test_deactivating_a_moving_component_ends_its_controllers_and_brakes_first() -> None:
    two = Two().going()
    change = two.loop.component_transitions.ask("hand", INACTIVE)
    two.cycle()
    assert two.active() == ["shoulder", "elbow"]
    assert not change.done and two.hand.state is ACTIVE
    two.cycle(20)
    assert "hold" not in two.hand.calls  # The deactivation runs in the background.
    two.work()
    assert change.done and two.hand.state is INACTIVE
    assert gentle(two.hand.written)
    reads, writes = two.hand.calls.count("read"), len(two.hand.written)
    two.cycle(3)
    assert (two.hand.calls.count("read"), len(two.hand.written)) == (reads + 3, writes)


def test_no_controller_is_activated_while_its_component_comes_to_rest() -> None:
    two = Two().going()
    change = two.loop.component_transitions.ask("hand", INACTIVE)
    two.cycle()
    again = SwitchRequest(activate=("finger_controller",))
    with pytest.raises(SwitchError, match="'finger/position' is not available: is its hardware component active"):
        two.manager.switch(again, two.loop.command)
    two.cycle(20)
    two.work()
    assert change.done and two.active() == ["shoulder", "elbow"]
    two.set(ACTIVE).result()
    two.manager.switch(again, two.loop.command)
    assert two.active() == ["shoulder", "elbow", "finger"]


def test_controllers_of_an_inactive_arm_are_deactivated_at_the_end() -> None:
    two = Two().up()
    for name in ("arm", "hand"):
        two.set(INACTIVE, name).result()
    reporter = Puppet()
    reporter.command_interfaces = reporter.state_interfaces = ()
    two.manager.registry.add(reporter)
    two.manager.activate_each([reporter.name], two.states[-1], two.loop.command)
    assert two.manager.registry.loaded[reporter.name].active
    assert shut_down(two.loop, relax=False, park=None, velocity_scale=1.0) == []
    assert not two.manager.registry.loaded[reporter.name].active


def test_other_components_keep_their_cycles_while_a_component_is_configured() -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    change = two.loop.component_transitions.ask("hand", ACTIVE)
    two.cycle(10)
    assert not change.done
    assert two.components.components[1].switching
    assert fault_texts(two.states[-1]) == {"finger": "hand is being switched"}
    assert two.arm.calls[-2:] == ["read", "write"]
    two.work()
    assert change.done and two.states[-1].faults == {}


def test_a_failed_transition_is_reported_and_its_completed_steps_remain() -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    two.hand.failing["configure"] = PortMissing("/dev/hand is not there: plug it in")
    with pytest.raises(PortMissing, match="plug it in"):
        two.set(ACTIVE).result()
    assert two.hand.state is UNCONFIGURED
    two.hand.failing = {"activate": RuntimeError("a defect")}
    with pytest.raises(RuntimeError, match="a defect"):
        two.set(ACTIVE).result()
    assert two.hand.state is INACTIVE
    with pytest.raises(Exception, match="hardware component 'foot' does not exist"):
        two.set(ACTIVE, "foot").result()


def test_requests_for_one_component_are_served_one_after_the_other() -> None:
    two = Two().up()
    changes = [
        two.loop.component_transitions.ask("hand", target) for target in (INACTIVE, ACTIVE, UNCONFIGURED, ACTIVE)
    ]
    for _ in range(20):
        two.cycle()
        two.work()
    assert all(change.done for change in changes)
    assert two.hand.changes()[2:] == ["hold", "activate", "hold", "cleanup", "configure", "activate"]


def test_an_activated_component_without_a_measurement_is_deactivated_again() -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    two.hand._position[:] = np.nan
    with pytest.raises(Exception, match="not activated: could not measure finger"):
        two.set(ACTIVE).result()
    assert two.hand.changes()[-1] == "relax"


def test_a_component_that_cannot_be_deactivated_again_does_not_stop_the_loop(caplog: pytest.LogCaptureFixture) -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    two.hand._position[:] = np.nan
    two.hand.failing["relax"] = RuntimeError("stuck")
    with pytest.raises(Exception, match="could not measure finger"):
        two.set(ACTIVE).result()
    assert "torque may still be on: could not switch hand off: stuck" in caplog.text
    two.cycle(3)
    assert two.hand.changes()[-1] == "cleanup"
    assert two.active() == ["shoulder", "elbow"]


def test_an_error_in_the_first_reading_is_reported_to_the_client() -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    two.hand.failing["read"] = RuntimeError("a defect")
    change = two.set(ACTIVE)
    with pytest.raises(RuntimeError, match="a defect"):
        change.result()
    assert two.active() == ["shoulder", "elbow"]


def test_a_component_lost_during_its_deactivation_is_dropped() -> None:
    two = Two().going()
    change = two.loop.component_transitions.ask("hand", INACTIVE)
    two.cycle()
    two.hand.failing["write"] = PortLost(GONE)
    two.cycle(20)
    assert two.hand.state is UNCONFIGURED
    with pytest.raises(PortLost):
        change.result()


def test_a_slow_component_is_read_and_written_at_its_own_rate() -> None:
    two = Two(cycles_per_update=(1, 4)).up()
    two.cycle(16)
    begin = 2  # number of readings that must agree before a component is commanded
    assert two.arm.calls.count("read") == begin + 16
    assert two.hand.calls.count("read") == begin + 4
    assert len(two.hand.written) == 4
    two.movers["finger"].speed = SPEED_RAD_S
    two.cycle(12)
    steps = np.diff(np.array(two.hand.written[-3:]), axis=0)
    np.testing.assert_allclose(steps, 4 * SPEED_RAD_S * PERIOD_S)


def test_a_controller_cannot_use_an_unavailable_component() -> None:
    two = Two().up()
    ready, measured = two.components.ready, two.components.measured
    assert ready("finger/position") and measured("finger/velocity")
    two.set(INACTIVE).result()
    assert not ready("finger/position") and measured("finger/velocity")
    two.set(UNCONFIGURED).result()
    assert not measured("finger/velocity") and ready("shoulder/position")
    with pytest.raises(SwitchError, match="command interface 'finger/position' is not available"):
        two.manager.switch(SwitchRequest(activate=("finger_controller",)), two.loop.command)


def test_a_controller_without_commands_stays_active_without_the_component() -> None:
    two = Two().up()
    eye = Mover("eye")
    eye.command_interfaces, eye.state_interfaces = (), ("finger/position", "elbow/position")
    eye.command = np.empty(0)
    two.manager.registry.add(eye)
    two.set(UNCONFIGURED).result()
    two.manager.switch(SwitchRequest(activate=("eye_controller",)), two.loop.command)
    two.cycle()
    assert two.manager.registry.state("eye_controller") is ACTIVE


def test_open_requests_are_refused_at_the_end() -> None:
    two = Two().up()
    waiting = two.loop.component_transitions.ask("hand", INACTIVE)
    two.loop.component_transitions.end()
    late = two.loop.component_transitions.ask("hand", INACTIVE)
    for change in (waiting, late):
        assert change.done
        with pytest.raises(RuntimeError, match=ENDED):
            change.result()


def test_a_component_that_returns_after_the_last_cycle_does_not_leap() -> None:
    two = Two().up()
    two.set(UNCONFIGURED).result()
    change = two.loop.component_transitions.ask("hand", ACTIVE)
    two.cycle()
    two.hand._position[:] = 0.9
    assert shut_down(two.loop, False, None, 1.0, settle=lambda: [work() for work in two.background].clear()) == []
    assert change.done and two.loop.command[2] == pytest.approx(0.9)
    assert two.hand.changes()[-2:] == ["hold", "cleanup"]


def test_at_the_end_joints_stop_before_background_work_is_awaited() -> None:
    two = Two().going()
    two.set(UNCONFIGURED).result()
    two.loop.component_transitions.ask("hand", ACTIVE)
    two.cycle()
    speed: list[float] = []

    def settle() -> None:
        speed.extend(np.diff(np.array(two.arm.written[-2:]), axis=0)[0] / PERIOD_S)
        two.background[0]()

    assert np.abs(np.diff(np.array(two.arm.written[-2:]), axis=0)).max() > 0.05
    assert shut_down(two.loop, False, None, 1.0, settle=settle) == []
    np.testing.assert_allclose(speed, 0.0, atol=1e-9)
    assert gentle(two.arm.written)


def test_a_loop_kept_alive_starts_without_a_component_that_cannot_be_activated(
    caplog: pytest.LogCaptureFixture,
) -> None:
    two = Two(keep_alive=True)
    two.hand.failing["activate"] = PortLost(GONE)
    two.up()
    two.cycle()
    assert (two.arm.state, two.hand.state) == (ACTIVE, INACTIVE)
    assert two.active() == ["shoulder", "elbow"]
    refused = Two()
    refused.hand.failing["activate"] = PortLost(GONE)
    with pytest.raises(PortLost):
        refused.up()
    asked = Two(keep_alive=True)
    asked.hand.failing["activate"] = PortLost(GONE)
    configure_all(asked.components)
    with pytest.raises(PortLost):
        asked.loop.activate(keep_alive=False)


# Joints that are activated again


class Limping(Breakable):
    """Mock hardware whose joints can lose their torque."""

    def __init__(self, name: str, joints: Sequence[str], clock: SimulatedClock) -> None:
        super().__init__(name, joints, clock)
        self.lost: frozenset[str] = frozenset()

    @property
    def without_torque(self) -> frozenset[str]:
        return self.lost

    def reactivate(self) -> frozenset[str]:
        self.call("reactivate")
        again, self.lost = self.lost, frozenset()
        return again


class Asking(Limping):
    """Mock hardware that detects lost torque only after a torque check."""

    def __init__(self, name: str, joints: Sequence[str], clock: SimulatedClock) -> None:
        super().__init__(name, joints, clock)
        self.limp: frozenset[str] = frozenset()
        self.unanswered: list[frozenset[str]] = []

    def ask_for_torque(self) -> frozenset[str]:
        self.call("ask")
        self.lost = self.limp
        return self.unanswered.pop(0) if self.unanswered else frozenset()


def limping() -> tuple[Two, Limping]:
    """Return a rig in which all joints move and the elbow has lost its torque and sunk to -0.7."""
    two = Two()
    arm = Limping("arm", ("shoulder", "elbow"), two.clock)
    two.components.components[0].hardware = two.arm = arm
    two.going()
    arm.lost = frozenset({"elbow"})
    arm.calls.clear()
    return two, arm


def asking() -> tuple[Two, Asking]:
    """Return a rig in which all joints move under torque."""
    two = Two()
    arm = Asking("arm", ("shoulder", "elbow"), two.clock)
    two.components.components[0].hardware = two.arm = arm
    two.going()
    arm.calls.clear()
    return two, arm


def test_a_joint_without_torque_is_activated_again_while_its_component_stays_active() -> None:
    two, arm = limping()
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle()
    assert two.active() == ["finger"], "the component's controllers end, the other component's go on"
    two.cycle(20)
    assert gentle(arm.written)
    held = arm.written[-1].copy()
    written = len(arm.written)
    arm._position[:] = held[0] - 0.01, -0.7  # One joint yields slightly under its load, and the other has sunk.
    for mover in two.movers.values():
        mover.speed = 0.0
    two.work()
    assert change.result() is None
    assert arm.changes() == ["reactivate"]
    assert two.active() == ["shoulder", "elbow", "finger"]
    two.cycle(2)
    np.testing.assert_allclose(arm.written[written:], [(held[0], -0.7)] * 3)


def test_a_failed_reactivation_leaves_the_component_as_before() -> None:
    two, arm = limping()
    arm.failing["reactivate"] = ActivationError("not activated: elbow is silent")
    change = two.set(ACTIVE, "arm")
    with pytest.raises(ActivationError, match="elbow is silent"):
        change.result()
    assert (arm.state, arm.changes()) == (ACTIVE, ["reactivate"])
    assert two.active() == ["shoulder", "elbow", "finger"]


def test_a_reactivated_joint_that_cannot_be_commanded_does_not_release_the_others() -> None:
    two, arm = limping()
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle(20)
    arm._position[1] = 9.0  # far outside its limits
    two.work()
    with pytest.raises(ActivationError, match="elbow"):
        change.result()
    assert (arm.state, arm.changes()) == (INACTIVE, ["reactivate", "hold"])
    assert two.active() == ["finger"]


def test_an_active_component_with_full_torque_keeps_its_controllers() -> None:
    two, arm = limping()
    arm.lost = frozenset()
    assert two.set(ACTIVE, "arm").result() is None
    assert arm.changes() == []
    assert two.active() == ["shoulder", "elbow", "finger"]


def test_a_request_checks_the_torque_before_it_completes() -> None:
    two, arm = asking()
    arm.limp = frozenset({"elbow"})
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle()
    assert not change.done and two.active() == ["finger"]
    two.cycle(20)
    arm.limp = frozenset()
    two.work()
    assert change.result() is None
    assert arm.changes() == ["ask", "reactivate"]


def test_a_request_repeats_a_torque_check_whose_answer_was_lost() -> None:
    two, arm = asking()
    arm.unanswered = [frozenset({"elbow"})]
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle()
    assert not change.done
    two.cycle()
    assert change.result() is None
    assert two.active() == ["shoulder", "elbow", "finger"], "nothing ends meanwhile"


def test_a_joint_that_never_reports_its_torque_is_named() -> None:
    two, arm = asking()
    arm.unanswered = [frozenset({"elbow"})] * 100
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle(10)
    with pytest.raises(LifecycleError, match=r"^arm: elbow did not report whether torque is enabled"):
        change.result()
    assert two.active() == ["shoulder", "elbow", "finger"]


def test_a_torque_check_on_a_lost_port_loses_the_component() -> None:
    two, arm = asking()
    arm.failing["ask"] = PortLost(GONE)
    change = two.loop.component_transitions.ask("arm", ACTIVE)
    two.cycle()
    with pytest.raises(PortLost, match=GONE):
        change.result()
    assert two.active() == ["finger"]

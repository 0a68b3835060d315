"""Fixtures and markers of servoloop.testing, as used in tests of users."""

import math
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.interface import ControllerContext
from controller.manager_errors import SwitchError
from controller.parameters import Parameters
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from controller.trajectory.tolerances import Tolerances
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants import Invariant
from servoloop.testing import plugin
from servoloop.testing.arm import ArmTestError, VirtualArm
from servoloop.testing.processes import ProcessTestError, VirtualBusProcess
from sim_backend.faults.fault_error import FaultError


class Never(Invariant):
    name = "never"

    def on_state(self, state: JointState) -> None:
        self.say("it moved")


class NeverActivated(Invariant):
    """The program does not end before a cycle."""

    name = "never activated"

    def on_state(self, state: JointState) -> None:
        self.examined += 1

    def at_end(self) -> None:
        if not self.examined:
            self.say("the program ended before its first cycle")


class DriftParameters(Parameters):
    joint: str

    def claims(self) -> tuple[str, ...]:
        return (f"{self.joint}/position",)

    def tolerances(self) -> Tolerances:
        return Tolerances(goal={self.joint: 0.01})


class Drift:
    """Controller that accepts goals of one joint, does not move, and reports success after ten cycles."""

    kind = "tests/Drift"
    parameters_type = DriftParameters

    def __init__(self, name: str, parameters: DriftParameters) -> None:
        self.name, self.parameters, self.joints = name, parameters, (parameters.joint,)
        self.command_interfaces = self.state_interfaces = parameters.claims()
        self.command: FloatArray = np.full(1, np.nan)
        self.goal: GoalHandle | None = None
        self.cycles = 0

    @classmethod
    def build(cls, name: str, parameters: Any, context: ControllerContext) -> Self:
        return cls(name, parameters)

    def check(self, goal: TrajectoryGoal) -> str | None:
        return None if goal.points[0].positions[0] >= 0.0 else "it goes up only"

    def submit(self, goal: TrajectoryGoal) -> GoalHandle:
        self.goal, self.cycles = GoalHandle(goal), 0
        return self.goal

    def cancel(self, handle: GoalHandle) -> None: ...

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.command = command

    def deactivate(self, reason: str = "") -> None: ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.cycles += 1
        if self.goal is not None and self.cycles > 10:
            self.goal.decide(GoalStatus.SUCCEEDED, 0, "")

    def settled(self) -> bool:
        return True


class Crashing(Drift):
    """Controller that fails in its first cycle."""

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        raise ZeroDivisionError("division by zero")


def drifting(arm: VirtualArm) -> VirtualArm:
    """Replace the controller of the hand by ``Drift``."""
    arm.up()
    arm.load_controller("drift", Drift, joint="hand_right_joint")
    arm.switch_controllers(activate=["drift"], deactivate=["hand_controller"])
    return arm


def test_goal_is_reached_on_the_default_arm(virtual_arm: VirtualArm) -> None:
    virtual_arm.up()
    goal = virtual_arm.send_goal({"joint2": -0.3}, seconds=1.0)
    virtual_arm.run(5.0, until=lambda: goal.done)
    assert goal.status is GoalStatus.SUCCEEDED
    assert virtual_arm.positions["joint2"] == pytest.approx(-0.3, abs=0.02)
    assert 1.0 < virtual_arm.time_s < 5.0


@pytest.mark.virtual_arm("so101", backlash_deg=0.0)
@pytest.mark.faults("silent id=3 at=0.2s for=0.5s")
def test_faults_come_from_markers_and_from_calls(virtual_arm: VirtualArm) -> None:
    virtual_arm.up()
    virtual_arm.run(0.5)
    assert virtual_arm.state is not None and set(virtual_arm.state.faults) == {"elbow_flex"}
    virtual_arm.run(1.0)
    assert virtual_arm.state.faults == {}
    virtual_arm.fault("silent id=2 for=0.5s")
    virtual_arm.run(0.2)
    assert set(virtual_arm.state.faults) == {"shoulder_lift"}


@pytest.mark.invariants(also=[Never])
def test_injected_fault_is_reported_with_its_time_since_activation(virtual_arm: VirtualArm) -> None:
    virtual_arm.up().run(0.45)
    virtual_arm.fault("noise at=0.1s for=0.2s")
    assert "kind: noise\n  at_s: 0.6" in virtual_arm.end()
    virtual_arm._watch.violations.clear()


@pytest.mark.seeds(2, first=5)
@pytest.mark.random_faults(3, within_s=1.0)
def test_each_seed_has_its_own_arm_and_faults(virtual_arm: VirtualArm, seed: int) -> None:
    assert seed in (5, 6) and virtual_arm.seed == seed
    virtual_arm.up().run(1.5)


@pytest.mark.invariants(also=[Never])
def test_violation_is_reported_with_its_time_and_the_faults(virtual_arm: VirtualArm) -> None:
    virtual_arm.plan("noise at=0.1s for=0.2s")
    virtual_arm.up()
    report = virtual_arm.end()
    assert report.startswith("never: it moved (at 0.") and "kind: noise" in report
    virtual_arm._watch.violations.clear()  # otherwise, the planted bug would also make this test fail
    assert virtual_arm.end() == ""


def test_arm_that_was_not_activated_is_shut_down_and_checked() -> None:
    arm = VirtualArm({}, also=(NeverActivated,))
    arm.plan("silent id=3 since=start")
    with pytest.raises((DriverError, HalError), match="servo 3"):
        arm.up()
    assert not arm.stack.ending
    assert arm.end().startswith("never activated: the program ended before its first cycle (at ")
    assert arm.stack.ending


def test_invariants_check_goals_of_user_controllers(virtual_arm: VirtualArm) -> None:
    arm = drifting(virtual_arm)
    goal = arm.send_goal({"hand_right_joint": 0.05}, controller="drift")
    arm.cancel(goal)
    assert arm.examined["cancels are followed"] == arm.examined["success is true"] == 0
    arm.run(1.0, until=lambda: goal.done)
    report = arm.end()
    assert goal.status is GoalStatus.SUCCEEDED
    assert "success is true: a goal succeeded with hand_right_joint at " in report and " s)" in report
    assert "cancels are followed: a goal canceled at " in report
    assert min(arm.examined["cancels are followed"], arm.examined["success is true"]) > 0
    arm._watch.violations.clear()


def test_only_controllers_with_goals_accept_goals_and_cancel_their_own(virtual_arm: VirtualArm) -> None:
    arm = drifting(virtual_arm)
    with pytest.raises(
        ArmTestError, match="there is no controller 'drifts': choose one of joint_state_broadcaster, arm_controller"
    ):
        arm.send_goal({"joint1": 0.0}, controller="drifts")
    with pytest.raises(
        ArmTestError, match=r"hand_controller does not accept goals: .* joints, check, .* and parameters\.tol"
    ):
        arm.send_goal({"joint1": 0.0}, controller="hand_controller")
    with pytest.raises(ArmTestError, match="drift has no joint 'joint1': choose from hand_right_joint"):
        arm.send_goal({"joint1": 0.0}, controller="drift")
    with pytest.raises(ArmTestError, match="drift rejects the goal: it goes up only"):
        arm.send_goal({"hand_right_joint": -0.1}, controller="drift")
    with pytest.raises(ArmTestError, match=r"the goal to cancel is unknown: pass the handle"):
        arm.cancel(GoalHandle(TrajectoryGoal((), ())))


@pytest.mark.parametrize(
    ("without", "report"),
    [
        ((), "no crash: the controller drift has failed: ZeroDivisionError: division by zero"),
        (("no crash",), ""),
    ],
)
def test_controller_that_crashes_is_reported(without: tuple[str, ...], report: str) -> None:
    arm = VirtualArm({}, without=without).up()
    arm.load_controller("drift", Crashing, joint="hand_right_joint")
    arm.switch_controllers(activate=["drift"], deactivate=["hand_controller"])
    arm.run(0.2)
    assert arm.end() == report


def test_controller_crash_that_was_injected_is_not_reported() -> None:
    arm = VirtualArm({})
    arm.plan("controller_raises at=0.1s for=0.1s")
    arm.up().run(0.3)
    assert arm.end() == ""


def test_invariant_that_examined_nothing_is_reported_with_its_condition() -> None:
    arm = VirtualArm({}, also=(Never,), examined=("cancels are followed", "safe commands", "never"))
    arm.up()
    assert arm.end().splitlines()[-2:] == [
        "cancels are followed: the condition of this invariant never occurred. Make the condition occur, or remove "
        "the name from `examined`. The invariant: A canceled goal brakes and soon ends as canceled, with the "
        "joints at rest, unless it has already ended.",
        "never: the condition of this invariant never occurred. Make the condition occur, or remove the name from "
        "`examined`. Your own invariants must count their examinations in `self.examined`.",
    ]


def test_errors_explain_the_correction(virtual_arm: VirtualArm) -> None:
    with pytest.raises(ArmTestError, match=r"call virtual_arm\.up\(\) first"):
        virtual_arm.run(1.0)
    with pytest.raises(ArmTestError, match=r"call virtual_arm\.up\(\) first"):
        virtual_arm.send_goal({"joint1": 0.0})
    with pytest.raises(ArmTestError, match=r"call virtual_arm\.up\(\) first"):
        virtual_arm.fault("silent id=3")
    virtual_arm.up()
    with pytest.raises(ArmTestError, match=r"plan\(\) has no effect after up\(\): call it before, or call"):
        virtual_arm.plan("silent id=3")
    with pytest.raises(ArmTestError, match=r"draw\(\) has no effect after up\(\): call it before, or call"):
        virtual_arm.draw()
    with pytest.raises(ArmTestError, match="arm_controller has no joint 'elbow': choose from joint1"):
        virtual_arm.send_goal({"elbow": 0.0})
    with pytest.raises(ArmTestError, match="rejects the goal"):
        virtual_arm.send_goal({"joint1": 100.0})
    with pytest.raises(SwitchError):
        virtual_arm.switch_controllers(activate=["sway"])
    with pytest.raises(FaultError):
        virtual_arm.fault("silence id=3")
    with pytest.raises(ArmTestError, match="there is no invariant 'safe wires': choose from safe wire"):
        VirtualArm({}, without=("safe wires",))
    with pytest.raises(ArmTestError, match="there is no invariant 'never': choose from safe wire"):
        VirtualArm({}, examined=("never",))
    with pytest.raises(ArmTestError, match="'no crash' has no condition that a test could meet: remove it from"):
        VirtualArm({}, examined=("no crash",))
    with pytest.raises(ArmTestError, match="'safe wire' is in both `without` and `examined`: remove the name from one"):
        VirtualArm({}, without=("safe wire",), examined=("safe wire",))


@pytest.mark.slow
def test_violated_invariants_fail_the_test_and_unknown_options_are_named(tmp_path: Path) -> None:
    from tests.testing.test_docs import pytest_in

    (tmp_path / "test_it.py").write_text(
        "import pytest\n"
        "from tests.testing.test_plugin import Never\n\n"
        "@pytest.mark.invariants(also=[Never])\n"
        "def test_falls(virtual_arm):\n    virtual_arm.up()\n\n"
        "@pytest.mark.invariants(also=[Never])\n"
        "def test_fails_by_itself(virtual_arm):\n    virtual_arm.up()\n    assert 1 == 2\n\n"
        "@pytest.mark.invariants(examined=['success is true'])\n"
        "def test_examines_nothing(virtual_arm):\n    virtual_arm.up()\n\n"
        "@pytest.mark.virtual_arm(arms='so101')\n"
        "def test_option(virtual_arm): ...\n\n"
        "@pytest.mark.invariants(examine=['success is true'])\n"
        "def test_misspelled(virtual_arm): ...\n\n"
        "@pytest.mark.invariants(without='safe wire')\n"
        "def test_no_list(virtual_arm): ...\n\n"
        "@pytest.mark.invariants('safe wire')\n"
        "def test_without_a_key(virtual_arm): ...\n"
    )
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {Path(__file__).resolve().parents[2]}\n")
    output = pytest_in(tmp_path).stdout
    assert "never: it moved" in output and "to reproduce: pytest 'test_it.py::test_falls'" in output
    assert "assert 1 == 2" in output and "virtual_arm accepts the arm and" in output and "not arms" in output
    assert "success is true: the condition of this invariant never occurred" in output
    assert "invariants accepts the lists also, without and examined, not examine" in output
    assert "invariants(without='safe wire') must be a list: ['safe wire']" in output
    assert "invariants accepts the lists also, without and examined, not 'safe wire'" in output
    assert "3 failed" in output and "4 errors" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("0", "seeds needs a count of at least 1, not 0"),
        ("'2'", "seeds needs a count of at least 1, not '2'"),
        ("True", "seeds needs a count of at least 1, not True"),
        ("2, first=-1", "seeds needs a first seed of at least 0, not -1"),
        ("", "write seeds(20) or seeds(20, first=5)"),
    ],
)
def test_seeds_that_would_not_run_the_test_are_refused(tmp_path: Path, arguments: str, message: str) -> None:
    from tests.testing.test_docs import pytest_in

    (tmp_path / "test_it.py").write_text(
        f"import pytest\n\n@pytest.mark.seeds({arguments})\ndef test_it(virtual_arm): ...\n"
    )
    output = pytest_in(tmp_path).stdout
    assert message in output and "1 error" in output


@pytest.mark.parametrize("seconds", [-1.0, math.nan, "1"])
def test_a_time_to_run_must_be_at_least_zero(virtual_arm: VirtualArm, seconds: Any) -> None:
    virtual_arm.up()
    with pytest.raises(ArmTestError, match="the time to run must be at least 0 s, not"):
        virtual_arm.run(seconds)


def test_an_unknown_controller_type_is_refused_with_the_known_types(virtual_arm: VirtualArm) -> None:
    with pytest.raises(ArmTestError, match=r"there is no controller type 'foo/Bar': choose one of .*/JointTraj"):
        virtual_arm.load_controller("x", "foo/Bar")


@pytest.mark.slow
def test_markers_without_effect_are_refused(tmp_path: Path) -> None:
    from tests.testing.test_docs import pytest_in

    pytest.importorskip("rclpy")
    (tmp_path / "test_it.py").write_text(
        "import pytest\n\n"
        "@pytest.mark.faults('silent id=3')\ndef test_stack(ros_stack): ...\n\n"
        "@pytest.mark.seeds(1)\ndef test_seeds(ros_stack): ...\n\n"
        "@pytest.mark.virtual_arm(backlash_deg=0.5)\ndef test_backlash(ros_stack): ...\n\n"
        "@pytest.mark.random_faults(3)\ndef test_bus(virtual_bus): ...\n\n"
        "@pytest.mark.invariants(without=['safe wire'])\ndef test_invariants(virtual_bus): ...\n\n"
        "@pytest.mark.rtf('max')\ndef test_arm(virtual_arm): ...\n\n"
        "@pytest.mark.rtf(speed=2.0)\ndef test_factor(ros_stack): ...\n\n"
        "@pytest.mark.faults(text='silent id=3')\ndef test_text(virtual_arm): ...\n\n"
        "@pytest.mark.virtual_arm('so101', 'robot.yaml')\ndef test_arguments(virtual_arm): ...\n\n"
        "@pytest.mark.random_faults(3)\ndef test_one_supports_it(virtual_arm, virtual_bus): ...\n"
    )
    output = pytest_in(tmp_path).stdout
    assert "1 passed" in output and "9 errors" in output
    assert (
        "`faults` has no effect on ros_stack: remove `faults`, or use the fixture virtual_arm or virtual_bus" in output
    )
    assert "`seeds` has no effect on ros_stack" in output and "`backlash_deg` has no effect on ros_stack" in output
    assert (
        "`random_faults` has no effect on virtual_bus: remove `random_faults`, or use the fixture virtual_arm" in output
    )
    assert "`invariants` has no effect on virtual_bus" in output and "`rtf` has no effect on virtual_arm" in output
    assert "rtf needs one factor of real time, or 'max'" in output
    assert "faults accepts only strings such as 'silent id=3', not text" in output
    assert "virtual_arm accepts the arm and urdf, robot, controllers, backlash_deg, not 'robot.yaml'" in output


@pytest.mark.parametrize(("marker", "factor"), [(pytest.mark.rtf("max"), "max"), (pytest.mark.rtf(factor=2.0), 2.0)])
def test_factor_is_accepted_with_and_without_its_name(
    request: pytest.FixtureRequest, marker: pytest.MarkDecorator, factor: object
) -> None:
    request.node.add_marker(marker)
    assert plugin._rtf(request.node) == factor


def test_virtual_bus_is_not_ready_before_its_port_can_be_opened(tmp_path: Path) -> None:
    """The emulator creates the socket of its scene before its port."""
    bus = VirtualBusProcess({"arm": "no such arm"}, tmp_path)
    (tmp_path / "bus.world").touch()
    with pytest.raises(ProcessTestError, match="no such arm"), bus.running():
        pass


def test_plugin_imports_nothing_on_its_own(tmp_path: Path) -> None:
    """pytest loads the plugin in every run in its environment."""
    from tests.testing.test_docs import pytest_in

    (tmp_path / "test_it.py").write_text(
        "import sys\n\ndef test_it():\n    assert not {'mujoco', 'numpy', 'rclpy', 'hal'} & set(sys.modules)\n"
    )
    ran = pytest_in(tmp_path, "-p", "no:hypothesispytest")
    assert ran.returncode == 0, ran.stdout

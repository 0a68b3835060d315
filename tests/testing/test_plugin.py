"""The fixtures and markers of servoloop.testing, as tests of users see them."""

from pathlib import Path

import pytest

from controller.action_goals import GoalStatus
from controller.manager.switch import SwitchError
from hal.types import JointState
from servoloop.campaign.invariants import Invariant
from servoloop.testing.arm import ArmTestError, VirtualArm
from sim_backend.faults.errors import FaultError


class Never(Invariant):
    name = "never"

    def on_state(self, state: JointState) -> None:
        self.say("it moved")


def test_a_goal_is_reached_on_the_arm_of_the_house(virtual_arm: VirtualArm) -> None:
    virtual_arm.up()
    goal = virtual_arm.send_goal({"joint2": -0.3}, seconds=1.0)
    virtual_arm.run(5.0, until=lambda: goal.done)
    assert goal.status is GoalStatus.SUCCEEDED
    assert virtual_arm.positions["joint2"] == pytest.approx(-0.3, abs=0.02)
    assert 1.0 < virtual_arm.time_s < 5.0


@pytest.mark.virtual_arm("so101", backlash_deg=0.0)
@pytest.mark.faults("silent id=3 at=0.2s for=0.5s")
def test_what_goes_wrong_when_is_said_by_markers_and_later_by_hand(virtual_arm: VirtualArm) -> None:
    virtual_arm.up()
    virtual_arm.run(0.5)
    assert virtual_arm.state is not None and set(virtual_arm.state.faults) == {"elbow_flex"}
    virtual_arm.run(1.0)
    assert virtual_arm.state.faults == {}
    virtual_arm.fault("silent id=2 for=0.5s")
    virtual_arm.run(0.2)
    assert set(virtual_arm.state.faults) == {"shoulder_lift"}


@pytest.mark.seeds(2, first=5)
@pytest.mark.random_faults(3, within_s=1.0)
def test_each_seed_has_its_own_arm_and_faults(virtual_arm: VirtualArm, seed: int) -> None:
    assert seed in (5, 6) and virtual_arm.seed == seed
    virtual_arm.up().run(1.5)


@pytest.mark.invariants(also=[Never])
def test_what_falls_is_named_with_its_time_and_the_faults(virtual_arm: VirtualArm) -> None:
    virtual_arm.plan("noise at=0.1s for=0.2s")
    virtual_arm.up()
    report = virtual_arm.end()
    assert report.startswith("never: it moved (at 0.") and "kind: noise" in report
    virtual_arm._watch.violations.clear()  # else this test fails for it, as it should
    assert virtual_arm.end() == ""


def test_mistakes_say_what_to_mend(virtual_arm: VirtualArm) -> None:
    with pytest.raises(ArmTestError, match=r"call virtual_arm\.up\(\) first"):
        virtual_arm.run(1.0)
    with pytest.raises(ArmTestError, match=r"call virtual_arm\.up\(\) first"):
        virtual_arm.send_goal({"joint1": 0.0})
    virtual_arm.up()
    with pytest.raises(ArmTestError, match="arm_controller has no joint 'elbow': joint1"):
        virtual_arm.send_goal({"elbow": 0.0})
    with pytest.raises(ArmTestError, match="refuses the goal"):
        virtual_arm.send_goal({"joint1": 100.0})
    with pytest.raises(SwitchError):
        virtual_arm.switch_controllers(activate=["sway"])
    with pytest.raises(FaultError):
        virtual_arm.fault("silence id=3")
    with pytest.raises(ArmTestError, match="there is no invariant 'safe wires': known are safe wire"):
        VirtualArm({}, without=("safe wires",))


@pytest.mark.slow
def test_a_test_fails_with_its_invariants_and_an_unknown_option_is_named(tmp_path: Path) -> None:
    from tests.testing.test_docs import pytest_in

    (tmp_path / "test_it.py").write_text(
        "import pytest\n"
        "from tests.testing.test_plugin import Never\n\n"
        "@pytest.mark.invariants(also=[Never])\n"
        "def test_falls(virtual_arm):\n    virtual_arm.up()\n\n"
        "@pytest.mark.invariants(also=[Never])\n"
        "def test_fails_by_itself(virtual_arm):\n    virtual_arm.up()\n    assert 1 == 2\n\n"
        "@pytest.mark.virtual_arm(arms='so101')\n"
        "def test_option(virtual_arm): ...\n"
    )
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {Path(__file__).resolve().parents[2]}\n")
    said = pytest_in(tmp_path).stdout
    assert "never: it moved" in said and "to see it again: pytest 'test_it.py::test_falls'" in said
    assert "assert 1 == 2" in said and "virtual_arm takes the arm and" in said and "not arms" in said
    assert "2 failed" in said and "1 error" in said


def test_the_plugin_brings_nothing_along(tmp_path: Path) -> None:
    """It is loaded into every pytest of its environment."""
    from tests.testing.test_docs import pytest_in

    (tmp_path / "test_it.py").write_text(
        "import sys\n\ndef test_it():\n    assert not {'mujoco', 'numpy', 'rclpy', 'hal'} & set(sys.modules)\n"
    )
    ran = pytest_in(tmp_path, "-p", "no:hypothesispytest")
    assert ran.returncode == 0, ran.stdout

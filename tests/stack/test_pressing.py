"""The effort of a jammed gripper is reduced, and the gripper is reported. Holding a cube does not count as a
failure."""

import pytest

from controller.diagnostics import Level, statuses
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.tolerances import Tolerances
from hal.types import JointState
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.text import parse
from tests.faults.rig import files_of

PRESSES_S = 2.5


class Rig(FaultyStack):
    """Stack that records the drive, alarms and diagnostics of the hand."""

    def __init__(self, arm: str) -> None:
        super().__init__(files=files_of(arm))
        self.state: JointState | None = None
        self.on_state = self._keep

    def _keep(self, state: JointState) -> None:
        self.state = state

    def hand_load(self) -> float:
        assert self.state is not None
        return abs(self.state.health[self.hand.joints[0]].load)

    def hand_status(self) -> tuple[Level, str]:
        joint = self.hand.joints[0]
        (found,) = [one for one in statuses(self.loop, "", {joint: "1"}, self.state) if joint in one.name]
        return found.level, found.message


@pytest.mark.parametrize(
    ("arm", "servo", "command", "holds"),
    [("so101", 6, 1.0, 0.2), ("robot_arm_dynamixel", 7, 0.05, 0.27)],
)
def test_jammed_hand_reduces_its_effort_and_is_reported_until_its_next_motion(
    arm: str, servo: int, command: float, holds: float
) -> None:
    rig = Rig(arm)
    rig.up()
    rig.player.play([parse(f"jammed id={servo} for=4s")], rig.world.time_s)
    rig.hand.submit([command])
    rig.run(0.5)
    full = rig.hand_load()
    assert full > 0.45 and rig.hand_status()[0] == Level.OK
    rig.run(PRESSES_S)
    assert rig.hand_load() < holds
    level, text = rig.hand_status()
    assert level == Level.WARN and f"servo {servo} has pressed with its torque limit" in text and "jammed" in text
    assert rig.state is not None and not rig.state.faults
    rig.hand.submit([0.5 * command])
    rig.run(0.5)
    assert rig.hand_load() == pytest.approx(full, abs=0.01)
    rig.run(1.5)  # the gears turn again
    position = rig.state.position[rig.loop.hardware.joints.index(rig.hand.joints[0])]
    assert position == pytest.approx(0.5 * command, abs=0.02)
    assert rig.hand_status() == (Level.OK, "ok")


def test_blocked_arm_joint_is_reported_while_it_drives_at_full_effort() -> None:
    rig = Rig("so101")
    rig.up()
    joint = rig.arm.joints[0]
    rig.player.play([parse("jammed id=1")], rig.world.time_s)
    point = GoalPoint((0.8, *rig.arm.command[1:].tolist()), 0.5)
    handle = rig.arm.submit(TrajectoryGoal(rig.arm.joints, (point,), Tolerances({joint: -1.0}, {joint: 0.02}, 1.5)))
    seen: list[str] = []

    def poll() -> None:
        assert rig.state is not None
        stall = rig.state.health[joint].stall
        seen.append(stall.text if stall else "")

    rig.after_cycle = poll
    rig.run(4.0, lambda: handle.done)
    assert any(text.startswith("servo 1 has pressed with at least 80% of its torque") for text in seen)
    rig.run(1.0)
    assert not seen[-1], "the goal's end has relieved it"


def test_an_inactive_component_reports_no_stall() -> None:
    rig = Rig("so101")
    rig.up()
    rig.player.play([parse("jammed id=6")], rig.world.time_s)
    rig.hand.submit([1.0])
    rig.run(1.5)
    assert rig.hand_status()[0] == Level.WARN
    rig.hardware.deactivate(relax=True)
    rig.state = rig.hardware.read()
    assert rig.hand_status() == (Level.OK, "ok")

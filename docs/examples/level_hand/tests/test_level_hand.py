"""Tests of the level hand on a virtual SO-101, with and without silent servos."""

import pytest
from level_hand.controller import LevelHand

from servoloop.campaign.invariants import Invariant

PITCH = ("shoulder_lift", "elbow_flex", "wrist_flex")
CONTROLLERS = "controllers.yaml"
DEVIATION_RAD = 0.15
SETTLES_S = 1.5


class StaysLevel(Invariant):
    """The hand keeps its pitch, except while a servo is silent and shortly after that."""

    name = "stays level"

    def __init__(self, stack, say, arm):
        super().__init__(stack, say, arm)
        self.pitch = None
        self.since_s = 0.0

    def on_state(self, state):
        pitch = sum(state.position[self.stack.loop.hardware.joints.index(joint)] for joint in PITCH)
        if state.faults or self.pitch is None:
            self.since_s = state.stamp_s
        self.pitch = pitch if self.pitch is None else self.pitch
        if abs(pitch - self.pitch) > DEVIATION_RAD and state.stamp_s - self.since_s > SETTLES_S:
            self.say(f"the hand has turned by {pitch - self.pitch:.2f} rad")


pytestmark = [pytest.mark.virtual_arm("so101", controllers=CONTROLLERS), pytest.mark.invariants(also=[StaysLevel])]


@pytest.fixture
def arm(virtual_arm):
    """Return an arm that is running, with its hand level."""
    virtual_arm.up()
    virtual_arm.load_controller("level_hand", LevelHand, wrist="wrist_flex", others=["shoulder_lift", "elbow_flex"])
    virtual_arm.switch_controllers(activate=["level_hand"])
    return virtual_arm


def work(arm):
    for lift in (-0.6, -0.2, -0.6, -0.2):
        goal = arm.send_goal({"shoulder_lift": lift, "elbow_flex": 0.4 - 0.5 * lift}, seconds=1.5)
        arm.run(4.0, until=lambda goal=goal: goal.done)
    arm.run(2.0)


def test_the_hand_stays_level(arm):
    work(arm)
    assert not arm.state.faults


@pytest.mark.seeds(12)
@pytest.mark.random_faults(3, within_s=6.0, kinds=["silent"])
def test_the_hand_stays_level_with_silent_servos(arm):
    work(arm)

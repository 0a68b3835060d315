"""Calls to the client of the arm, and messages, while buttons are held."""

from collections.abc import Mapping

import pytest

from servoloop.command_socket.command_errors import CommandError
from servoloop.dashboard.move_panel import STOPPED, Handling
from servoloop.manual.buttons import REPEATS_HZ, GoTo, HeldButtons, Turn
from servoloop.manual.joints_now import HandlingError
from sim_backend.clock import SimulatedClock

PID = 100
TURN = Turn("joint1", -0.5)


class Client:
    """Client that records its calls."""

    def __init__(self) -> None:
        self.asked: list[object] = []
        self.fault = ""
        self.there = False

    def jog(self, joint: str, share: float) -> None:
        if self.fault:
            raise HandlingError(self.fault)
        self.asked.append((joint, share))

    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool:
        self.asked.append((dict(pose), share))
        return self.there

    def stop(self) -> None:
        if self.fault:
            raise CommandError("timeout", self.fault)
        self.asked.append("stop")


class Rig:
    """Page with one button, in simulated time."""

    def __init__(self) -> None:
        self.clock, self.client = SimulatedClock(), Client()
        self.buttons = HeldButtons(self.clock)
        self.handling = Handling(self.buttons)
        self.handling.begin(PID)

    def hold(self, seconds: float, command: Turn | GoTo = TURN) -> list[object]:
        """Hold the button for a given time and return the calls to the client."""
        self.client.asked.clear()
        for _ in range(round(seconds * REPEATS_HZ)):
            self.buttons.hold("browser", command)
            self.pause(1.0 / REPEATS_HZ)
        return list(self.client.asked)

    def pause(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.handling.step(self.client)


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_a_joint_moves_only_while_its_button_is_held(rig: Rig) -> None:
    asked = rig.hold(1.0)
    assert set(asked) == {("joint1", -0.5)} and len(asked) >= 15
    assert rig.handling.message == "moving joint1 (−)"
    rig.buttons.release("browser")
    rig.client.asked.clear()
    rig.pause(0.01)
    assert not rig.client.asked


def test_a_pose_is_approached_at_the_selected_speed(rig: Rig) -> None:
    go = GoTo("home", {"joint1": 0.5}, 0.3)
    assert rig.hold(0.5, go)[0] == ({"joint1": 0.5}, 0.3) and rig.handling.message == "moving: home"
    rig.client.there = True
    rig.hold(0.2, go)
    assert rig.handling.message == "reached: home"


def test_stop_cancels_once_and_held_buttons_have_no_effect(rig: Rig) -> None:
    rig.hold(0.5)
    rig.handling.stop()
    assert rig.hold(1.0) == ["stop"] and rig.handling.message == STOPPED
    rig.buttons.release("browser")
    assert rig.hold(0.5)[0] == ("joint1", -0.5)


def test_a_fault_is_shown_and_its_end_does_not_resume_the_motion(rig: Rig) -> None:
    rig.hold(0.5)
    rig.client.fault = "joint1: servo 1 has lost its torque"
    assert rig.hold(0.3) == [] and rig.handling.message == "joint1: servo 1 has lost its torque"
    rig.client.fault = ""
    assert rig.hold(1.0) == [] and rig.handling.message == "joint1: servo 1 has lost its torque"
    rig.buttons.release("browser")
    assert rig.hold(0.5)


def test_a_restarted_stack_ignores_buttons_held_before(rig: Rig) -> None:
    rig.hold(0.5)
    rig.handling.stop()
    rig.hold(0.0)
    rig.handling.begin(PID + 1)
    assert rig.hold(0.5) == [], "neither the stop nor the press applies to the new stack"


def test_a_stop_that_was_not_sent_is_sent_over_the_next_connection_to_the_same_stack(rig: Rig) -> None:
    rig.hold(0.5)
    rig.handling.stop()
    rig.handling.begin(PID)
    assert rig.hold(0.5) == ["stop"], "the held button has no effect"


def test_a_stop_that_failed_is_repeated(rig: Rig) -> None:
    rig.client.fault = "the stack does not reply: check its log"
    rig.handling.stop()
    with pytest.raises(CommandError):
        rig.pause(0.1)
    rig.client.fault = ""
    rig.handling.begin(PID)
    rig.pause(0.1)
    rig.pause(0.1)
    assert rig.client.asked == ["stop"]

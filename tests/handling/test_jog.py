"""Keys of ``servoloop jog``, without ROS: each press is one motion, and the reason for a stop is shown."""

from collections.abc import Sequence
from io import StringIO
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from rich.live import Live

from hal.types import JointLimits
from servoloop.commands import jog
from servoloop.commands.jog import TAP_S, TICK_S, Jogging
from servoloop.manual.joints_now import HandlingError
from servoloop.stack import terminal as keys

JOINTS = ("joint1", "joint2", "hand")
LIMITS = dict.fromkeys(JOINTS, JointLimits(-1.0, 1.0, 2.0, float("inf"), float("inf")))
FIRST_REPEAT_S, REPEATS_S = 0.5, 0.04


class Client:
    """Client that moves joints while it is called. ``wrong`` is the reason with which the client refuses to move."""

    def __init__(self, now: "Terminal", joints: Sequence[str] = JOINTS) -> None:
        self.now, self.joints, self.wrong = now, joints, ""
        self.turned = dict.fromkeys(JOINTS, 0.0)
        self._last_s: float | None = None

    def jog(self, joint: str, share: float) -> None:
        if self.wrong or joint not in self.joints:
            raise HandlingError(self.wrong or f"no active controller moves {joint}: activate arm_controller")
        passed_s = 0.0 if self._last_s is None or self.now.s - self._last_s > 0.3 else self.now.s - self._last_s
        self.turned[joint] += share * passed_s
        self._last_s = self.now.s

    def listen(self) -> None:
        self._last_s = None

    def stop(self) -> None:
        pass


class Terminal:
    """Simulated time and held keys. ``late_s`` is the delay of each call on a busy machine."""

    def __init__(self) -> None:
        self.s, self.late_s = 10.0, 0.0
        self._held, self._next_s, self._repeats = "", 0.0, False

    def hold(self, key: str) -> None:
        """Hold a key down; an empty string releases it."""
        self._held, self._next_s, self._repeats = key, self.s, False

    def typed(self, wait_s: float) -> list[str]:
        self.s += wait_s + self.late_s
        if not self._held or self._next_s > self.s:
            return []
        self._next_s = self.s + (REPEATS_S if self._repeats else FIRST_REPEAT_S)
        self._repeats = True
        return [self._held]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    terminal = Terminal()
    monkeypatch.setattr(keys, "typed", terminal.typed)
    monkeypatch.setattr(jog, "monotonic", lambda: terminal.s)
    return terminal


def jogging(terminal: Terminal, joints: Sequence[str] = JOINTS) -> tuple[Jogging, Client]:
    client = Client(terminal, joints)
    robot: Any = SimpleNamespace(limits=LIMITS, snapshot=SimpleNamespace(joints=JOINTS, position=np.zeros(len(JOINTS))))
    return Jogging(client, robot), client  # type: ignore[arg-type]


def step(jog: Jogging, terminal: Terminal, seconds: float) -> None:
    end_s = terminal.s + seconds
    while terminal.s < end_s:
        jog.step()


def tap(jog: Jogging, terminal: Terminal, key: str) -> None:
    """Press a key and release it at once."""
    terminal.hold(key)
    jog.step()
    terminal.hold("")


def said(jog: Jogging) -> str:
    """Return the text below the table."""
    return str(jog.table(Console()).caption)


@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_a_short_key_press_moves_a_joint_for_a_tenth_of_a_second(terminal: Terminal, late_s: float) -> None:
    jog, client = jogging(terminal)
    terminal.late_s = late_s
    tap(jog, terminal, "right")
    step(jog, terminal, 2.0)
    assert TAP_S <= client.turned["joint1"] <= TAP_S + TICK_S + late_s
    tap(jog, terminal, "left")
    step(jog, terminal, 2.0)
    assert client.turned["joint1"] == pytest.approx(0.0, abs=TICK_S + late_s)


def test_a_joint_moves_while_the_key_is_held_and_stops_when_it_is_released(terminal: Terminal) -> None:
    jog, client = jogging(terminal)
    terminal.hold("right")
    step(jog, terminal, 2.0)
    turned = client.turned["joint1"]
    assert turned > 1.3
    terminal.hold("")
    step(jog, terminal, 1.0)
    assert client.turned["joint1"] <= turned + 0.35


def test_the_reason_for_a_stop_is_shown_and_a_new_motion_needs_a_new_press(terminal: Terminal) -> None:
    jog, client = jogging(terminal)
    terminal.hold("right")
    step(jog, terminal, 1.0)
    client.joints, turned = ("hand",), client.turned["joint1"]
    step(jog, terminal, 0.2)
    assert "no active controller moves joint1: activate arm_controller. Then press the key again" in said(jog)
    client.joints = JOINTS
    step(jog, terminal, 3.0)
    assert client.turned["joint1"] == turned, "the motion does not resume although the key is still held"
    assert "no active controller" in said(jog)
    terminal.hold("")
    step(jog, terminal, 1.0)
    terminal.hold("right")
    step(jog, terminal, 1.0)
    assert client.turned["joint1"] > turned + 0.2 and "no active controller" not in said(jog)


@pytest.mark.parametrize("between", ["space", "2", "down", "x"])
def test_another_key_ends_a_motion_until_the_first_key_is_pressed_again(terminal: Terminal, between: str) -> None:
    jog, client = jogging(terminal)
    terminal.hold("right")
    step(jog, terminal, 1.0)
    jog._press(between)
    turned = dict(client.turned)
    step(jog, terminal, 2.0)
    assert client.turned == turned, "although the first key still repeats"


def test_a_number_always_selects_the_same_joint(terminal: Terminal) -> None:
    jog, client = jogging(terminal, joints=("hand",))
    jog._press("1")
    tap(jog, terminal, "right")
    step(jog, terminal, 1.0)
    assert not any(client.turned.values()) and "no active controller moves joint1" in said(jog)
    terminal.s += 1.0
    jog._press("3")
    tap(jog, terminal, "right")
    step(jog, terminal, 1.0)
    assert client.turned["hand"] >= TAP_S and client.turned["joint1"] == 0.0


@pytest.mark.parametrize("width", [100, 50])
@pytest.mark.parametrize("chosen", [1, 12, 25, 30])
def test_the_selected_joint_and_the_help_fit_on_the_terminal(terminal: Terminal, chosen: int, width: int) -> None:
    joints = tuple(f"joint{number}" for number in range(1, 31))
    snapshot = SimpleNamespace(joints=joints, position=np.zeros(len(joints)))
    robot: Any = SimpleNamespace(limits=dict.fromkeys(joints, LIMITS["hand"]), snapshot=snapshot)
    jog = Jogging(Client(terminal, joints), robot)  # type: ignore[arg-type]
    for _ in range(chosen - 1):
        jog._press("down")
    jog._message = "no active controller moves the joint: activate arm_controller. Then press the key again."
    console = Console(file=StringIO(), force_terminal=True, width=width, height=24)
    with Live(console=console, get_renderable=lambda: jog.table(console), auto_refresh=False) as live:
        live.refresh()
        shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert f"joint{chosen} " in shown and "quit" in shown and "the key again" in shown
    assert shown.count(" joint") > 5

"""Commands and display of the folder *Move* on the page, without a browser."""

import asyncio
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from servoloop.dashboard.move_panel import NONE, SLOWEST, MovePanel
from servoloop.dashboard.server import PageServer
from servoloop.manual.buttons import REPEATS_HZ, TAKEN, Command, GoTo, HeldButtons, Turn
from servoloop.manual.poses import CLOSE, NO_TARGETS, OPEN, MoveTargets
from sim_backend.clock import SimulatedClock

TARGETS = MoveTargets(
    ("joint1", "joint2"),
    {OPEN: {"finger": 0.0}, CLOSE: {"finger": 0.05}},
    {"home": {"joint1": 0.1}},
    ("far is not available: joint1: <9>",),
)


class Panel:
    """Panel whose mover does nothing, with simulated browsers."""

    def __init__(self, server: PageServer) -> None:
        self.clock, self.stops = SimulatedClock(), 0
        self.mover: Any = SimpleNamespace(
            buttons=HeldButtons(self.clock), targets=NO_TARGETS, message="no ROS here", stop=self.stop
        )
        self.panel = MovePanel(server, self.mover, 0.5)
        self.panel.show()
        self.notices: list[str] = []

    def stop(self) -> None:
        self.stops += 1

    def set_targets(self, targets: MoveTargets) -> None:
        self.mover.targets = targets
        self.panel.show()

    def button(self, label: str) -> Any:
        buttons = {one.label: one for one in (*self.panel._needs_arm, self.panel._go)}
        return buttons[label]

    def hold(self, label: str, browser: int = 1, words: int = 10) -> Command | None:
        """Hold a button for a number of reports, and return the resulting command."""
        client = SimpleNamespace(add_notification=lambda title, body, **_: self.notices.append(body))
        event = SimpleNamespace(client=client, client_id=browser)
        for _ in range(words):
            for called in self.button(label)._button_impl.hold_cbs_from_freq[REPEATS_HZ]:
                asyncio.run(called(event))
            self.clock.sleep_until(self.clock.now() + 1.0 / REPEATS_HZ)
        found: Command | None = self.mover.buttons.command()
        return found

    def click(self, label: str, browser: int = 1) -> None:
        for called in self.button(label)._impl.update_cb:
            asyncio.run(called(SimpleNamespace(client=None, client_id=browser)))


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


@pytest.fixture
def panel(server: PageServer) -> Panel:
    return Panel(server)


def test_the_panel_shows_why_the_arm_cannot_be_moved_and_disables_its_buttons(panel: Panel) -> None:
    assert "no ROS here" in panel.panel._text.content
    assert all(button.disabled or not button.visible for button in (*panel.panel._needs_arm, panel.panel._go))
    panel.set_targets(TARGETS)
    assert not any(button.disabled or not button.visible for button in (*panel.panel._needs_arm, panel.panel._go))
    assert "joint1: &lt;9&gt;" in panel.panel._text.content
    panel.set_targets(NO_TARGETS)
    assert panel.button("Stop everything").disabled and panel.panel._joint.options == (NONE,)


def test_each_button_sends_its_command(panel: Panel) -> None:
    panel.set_targets(TARGETS)
    panel.panel._joint.value = "joint2"
    panel.panel._share.value = 0.4
    said = {}
    for label in ("Move (−)", "Move (+)", "Open the hand", "Close the hand", "Go to the pose"):
        said[label] = panel.hold(label)
        panel.click(label)
        assert panel.mover.buttons.command() is None
    assert list(said.values()) == [
        Turn("joint2", -0.4),
        Turn("joint2", 0.4),
        GoTo(OPEN, {"finger": 0.0}, 0.4),
        GoTo(CLOSE, {"finger": 0.05}, 0.4),
        GoTo("home", {"joint1": 0.1}, 0.4),
    ]


def test_the_speed_sent_by_a_browser_is_limited(panel: Panel) -> None:
    panel.set_targets(TARGETS)
    for sent, taken in ((50.0, 1.0), (float("nan"), SLOWEST), (-3.0, SLOWEST)):
        panel.panel._share.value = sent
        assert panel.hold("Move (+)") == Turn("joint1", taken)
        panel.click("Move (+)")


def test_an_arm_without_hand_and_poses_has_no_buttons_for_them(panel: Panel) -> None:
    panel.set_targets(MoveTargets(("joint1",)))
    assert not panel.button("Open the hand").visible and not panel.panel._pose.visible
    assert panel.hold("Go to the pose") is None, "whatever a browser sends"


def test_a_second_browser_is_notified_that_the_arm_is_in_use(panel: Panel) -> None:
    panel.set_targets(TARGETS)
    first = panel.hold("Move (+)")
    assert panel.hold("Move (−)", browser=2, words=2) == first == Turn("joint1", 0.5)
    assert panel.notices == [TAKEN]


def test_stop_works_when_pressed_and_by_keyboard(panel: Panel) -> None:
    panel.set_targets(TARGETS)
    (called,) = panel.button("Stop everything")._button_impl.hold_cbs_from_freq[10.0]
    asyncio.run(called(SimpleNamespace()))
    assert panel.stops == 1
    panel.click("Stop everything")
    assert panel.stops == 2

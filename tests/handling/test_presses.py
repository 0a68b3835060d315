"""Held buttons: which reports are accepted, for how long, and which browser has control."""

from collections.abc import Iterable

import pytest

from servoloop.manual.buttons import GAP_S, GOOD_S, LONGEST_S, REPEATS_HZ, TAKEN, TOO_LONG, HeldButtons, Turn
from sim_backend.clock import SimulatedClock

LEFT, RIGHT = Turn("joint1", -1.0), Turn("joint2", 1.0)
PERIOD_S = 1.0 / REPEATS_HZ


class Page:
    """Browsers that report held buttons. Each browser has one button in these tests."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.buttons = HeldButtons(self.clock)
        self.said: list[str] = []

    def hold(self, button: str, seconds: float, command: Turn = LEFT, period_s: float = PERIOD_S) -> None:
        for _ in range(round(seconds / period_s)):
            self.said.append(self.buttons.hold(button, command))
            self.after(period_s)

    def after(self, seconds: float) -> Turn | None:
        """Return the command after a delay."""
        self.clock.sleep_until(self.clock.now() + seconds)
        command = self.buttons.command()
        assert command is None or isinstance(command, Turn)
        return command

    @property
    def refusals(self) -> list[str]:
        return [word for word in self.said if word]


@pytest.fixture
def page() -> Page:
    return Page()


def test_a_button_counts_only_while_the_browser_reports_it(page: Page) -> None:
    assert page.after(0.0) is None
    page.hold("a", 0.5)
    assert page.after(0.0) == LEFT
    assert page.after(GOOD_S - PERIOD_S + 0.01) is None, "the browser is gone without reporting a release"


def test_the_end_of_a_click_ends_the_press_at_once(page: Page) -> None:
    page.hold("a", 0.5)
    page.buttons.release("b")
    assert page.after(0.0) == LEFT
    page.buttons.release("a")
    assert page.after(0.0) is None
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT, "the next press counts"


@pytest.mark.parametrize("words", [1, 2])
def test_a_short_click_moves_nothing(page: Page, words: int) -> None:
    page.hold("a", words * PERIOD_S)
    assert page.after(0.0) is None


def test_delayed_reports_that_arrive_at_once_move_nothing(page: Page) -> None:
    for _ in range(200):
        page.buttons.hold("a", LEFT)
    assert all(page.after(0.01) is None for _ in range(50))


def test_a_hidden_page_that_reports_once_a_second_moves_nothing(page: Page) -> None:
    for _ in range(20):
        page.buttons.hold("a", LEFT)
        assert page.after(0.1) is None and page.after(0.9) is None


def test_a_browser_with_irregular_reports_still_moves_the_arm(page: Page) -> None:
    page.hold("a", 2.0, period_s=GAP_S / 2)
    page.buttons.hold("a", LEFT)
    assert page.after(0.0) == LEFT


def test_another_selection_does_not_change_the_motion_of_a_held_button(page: Page) -> None:
    page.hold("a", 0.3, LEFT)
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == LEFT


def test_the_first_browser_has_control_and_the_second_is_notified_once(page: Page) -> None:
    page.hold("a", 0.3)
    for _ in range(20):
        page.hold("a", PERIOD_S)
        page.hold("b", PERIOD_S, RIGHT)
        assert page.after(0.0) == LEFT
    assert page.refusals == [TAKEN]
    page.buttons.release("a")
    page.hold("b", 3.0, RIGHT)
    assert page.after(0.0) is None, "the arm does not move when the first browser releases its button"
    page.after(GAP_S + 0.01)
    page.hold("b", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT and page.refusals == [TAKEN]


def test_a_browser_that_was_silent_does_not_regain_control(page: Page) -> None:
    page.hold("a", 0.3)
    page.after(GOOD_S)
    page.hold("b", 0.3, RIGHT)
    page.hold("a", PERIOD_S)
    assert page.after(0.0) == RIGHT


def test_an_ended_motion_needs_another_press(page: Page) -> None:
    page.hold("a", 0.3)
    page.buttons.end()
    page.hold("a", 3.0)
    assert page.after(0.0) is None
    page.buttons.release("a")
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT


def test_a_press_ends_after_its_maximum_duration(page: Page) -> None:
    moved = 0
    for _ in range(round(3 * LONGEST_S / PERIOD_S)):
        page.hold("a", PERIOD_S)
        moved += page.after(0.0) is not None
    assert moved * PERIOD_S == pytest.approx(LONGEST_S, abs=0.3) and page.refusals == [TOO_LONG]


def test_buttons_that_no_longer_report_are_forgotten(page: Page) -> None:
    def clients() -> Iterable[str]:
        return (f"browser {number}" for number in range(1000))

    for client in clients():
        page.hold(client, PERIOD_S)
    page.after(GAP_S)
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT and not page.buttons._over

"""Held buttons in browsers: when a button counts as held, how long, and for which browser."""

from collections.abc import Iterable

import pytest

from servoloop.manual.buttons import GAP_S, GOOD_S, LONGEST_S, REPEATS_HZ, TAKEN, TOO_LONG, Presses, Turn
from sim_backend.clock import SimulatedClock

LEFT, RIGHT = Turn("joint1", -1.0), Turn("joint2", 1.0)
PERIOD_S = 1.0 / REPEATS_HZ


class Page:
    """Browsers that report their held button. Each has one button here."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.presses = Presses(self.clock)
        self.responses: list[str] = []

    def hold(self, who: str, seconds: float, wish: Turn = LEFT, period_s: float = PERIOD_S) -> None:
        for _ in range(round(seconds / period_s)):
            self.responses.append(self.presses.hold(who, wish))
            self.after(period_s)

    def after(self, seconds: float) -> Turn | None:
        """Return the action after a time in seconds."""
        self.clock.sleep_until(self.clock.now() + seconds)
        wish = self.presses.wish()
        assert wish is None or isinstance(wish, Turn)
        return wish

    @property
    def refusals(self) -> list[str]:
        return [text for text in self.responses if text]


@pytest.fixture
def page() -> Page:
    return Page()


def test_button_counts_only_while_the_browser_reports_it(page: Page) -> None:
    assert page.after(0.0) is None
    page.hold("a", 0.5)
    assert page.after(0.0) == LEFT
    assert page.after(GOOD_S - PERIOD_S + 0.01) is None, "the browser is gone, and has not reported the release"


def test_end_of_a_click_ends_the_motion_immediately(page: Page) -> None:
    page.hold("a", 0.5)
    page.presses.release("b")
    assert page.after(0.0) == LEFT
    page.presses.release("a")
    assert page.after(0.0) is None
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT, "the next press counts"


@pytest.mark.parametrize("words", [1, 2])
def test_short_click_moves_nothing(page: Page, words: int) -> None:
    page.hold("a", words * PERIOD_S)
    assert page.after(0.0) is None


def test_delayed_reports_move_nothing(page: Page) -> None:
    for _ in range(200):
        page.presses.hold("a", LEFT)
    assert all(page.after(0.01) is None for _ in range(50))


def test_hidden_page_with_one_report_per_second_moves_nothing(page: Page) -> None:
    for _ in range(20):
        page.presses.hold("a", LEFT)
        assert page.after(0.1) is None and page.after(0.9) is None


def test_stuttering_browser_still_moves_the_arm(page: Page) -> None:
    page.hold("a", 2.0, period_s=GAP_S / 2)
    page.presses.hold("a", LEFT)
    assert page.after(0.0) == LEFT


def test_new_choice_during_a_press_does_not_change_the_motion(page: Page) -> None:
    page.hold("a", 0.3, LEFT)
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == LEFT


def test_first_browser_has_the_motion_and_the_other_is_notified_once(page: Page) -> None:
    page.hold("a", 0.3)
    for _ in range(20):
        page.hold("a", PERIOD_S)
        page.hold("b", PERIOD_S, RIGHT)
        assert page.after(0.0) == LEFT
    assert page.refusals == [TAKEN]
    page.presses.release("a")
    page.hold("b", 3.0, RIGHT)
    assert page.after(0.0) is None, "the motion does not start when the first browser releases"
    page.after(GAP_S + 0.01)
    page.hold("b", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT and page.refusals == [TAKEN]


def test_browser_that_was_silent_does_not_regain_the_motion(page: Page) -> None:
    page.hold("a", 0.3)
    page.after(GOOD_S)
    page.hold("b", 0.3, RIGHT)
    page.hold("a", PERIOD_S)
    assert page.after(0.0) == RIGHT


def test_ended_motion_restarts_only_with_a_new_press(page: Page) -> None:
    page.hold("a", 0.3)
    page.presses.end()
    page.hold("a", 3.0)
    assert page.after(0.0) is None
    page.presses.release("a")
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT


def test_endless_press_is_ended(page: Page) -> None:
    moved = 0
    for _ in range(round(3 * LONGEST_S / PERIOD_S)):
        page.hold("a", PERIOD_S)
        moved += page.after(0.0) is not None
    assert moved * PERIOD_S == pytest.approx(LONGEST_S, abs=0.3) and page.refusals == [TOO_LONG]


def test_closed_browser_is_removed(page: Page) -> None:
    def clients() -> Iterable[str]:
        return (f"browser {number}" for number in range(1000))

    for client in clients():
        page.hold(client, PERIOD_S)
    page.after(GAP_S)
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT and not page.presses._over

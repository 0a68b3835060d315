"""Buttons that are held: what counts as held, for how long, and whose."""

from collections.abc import Iterable

import pytest

from servoloop.manual.buttons import GAP_S, GOOD_S, LONGEST_S, REPEATS_HZ, TAKEN, TOO_LONG, HeldButtons, Turn
from sim_backend.clock import SimulatedClock

LEFT, RIGHT = Turn("joint1", -1.0), Turn("joint2", 1.0)
PERIOD_S = 1.0 / REPEATS_HZ


class Page:
    """Browsers that say what is held; each has one button here."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.buttons = HeldButtons(self.clock)
        self.said: list[str] = []

    def hold(self, who: str, seconds: float, wish: Turn = LEFT, period_s: float = PERIOD_S) -> None:
        for _ in range(round(seconds / period_s)):
            self.said.append(self.buttons.hold(who, wish))
            self.after(period_s)

    def after(self, seconds: float) -> Turn | None:
        """What is to be done after so long."""
        self.clock.sleep_until(self.clock.now() + seconds)
        wish = self.buttons.command()
        assert wish is None or isinstance(wish, Turn)
        return wish

    @property
    def refusals(self) -> list[str]:
        return [word for word in self.said if word]


@pytest.fixture
def page() -> Page:
    return Page()


def test_a_button_counts_while_the_browser_says_so_and_no_longer(page: Page) -> None:
    assert page.after(0.0) is None
    page.hold("a", 0.5)
    assert page.after(0.0) == LEFT
    assert page.after(GOOD_S - PERIOD_S + 0.01) is None, "the browser is gone, and has not said that it was let go"


def test_the_end_of_a_click_ends_it_at_once(page: Page) -> None:
    page.hold("a", 0.5)
    page.buttons.release("b")
    assert page.after(0.0) == LEFT
    page.buttons.release("a")
    assert page.after(0.0) is None
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT, "and the next press counts"


@pytest.mark.parametrize("words", [1, 2])
def test_a_short_click_moves_nothing(page: Page, words: int) -> None:
    page.hold("a", words * PERIOD_S)
    assert page.after(0.0) is None


def test_words_that_a_network_has_kept_back_move_nothing(page: Page) -> None:
    for _ in range(200):
        page.buttons.hold("a", LEFT)
    assert all(page.after(0.01) is None for _ in range(50))


def test_a_hidden_page_that_says_a_word_a_second_moves_nothing(page: Page) -> None:
    for _ in range(20):
        page.buttons.hold("a", LEFT)
        assert page.after(0.1) is None and page.after(0.9) is None


def test_a_browser_that_stutters_still_moves_the_arm(page: Page) -> None:
    page.hold("a", 2.0, period_s=GAP_S / 2)
    page.buttons.hold("a", LEFT)
    assert page.after(0.0) == LEFT


def test_what_is_chosen_while_a_button_is_held_does_not_change_what_moves(page: Page) -> None:
    page.hold("a", 0.3, LEFT)
    page.hold("a", 0.3, RIGHT)
    assert page.after(0.0) == LEFT


def test_the_first_who_holds_has_it_and_the_other_is_told_once(page: Page) -> None:
    page.hold("a", 0.3)
    for _ in range(20):
        page.hold("a", PERIOD_S)
        page.hold("b", PERIOD_S, RIGHT)
        assert page.after(0.0) == LEFT
    assert page.refusals == [TAKEN]
    page.buttons.release("a")
    page.hold("b", 3.0, RIGHT)
    assert page.after(0.0) is None, "it does not move by itself when the first lets go"
    page.after(GAP_S + 0.01)
    page.hold("b", 0.3, RIGHT)
    assert page.after(0.0) == RIGHT and page.refusals == [TAKEN]


def test_one_that_was_silent_for_a_moment_does_not_take_it_back(page: Page) -> None:
    page.hold("a", 0.3)
    page.after(GOOD_S)
    page.hold("b", 0.3, RIGHT)
    page.hold("a", PERIOD_S)
    assert page.after(0.0) == RIGHT


def test_what_was_ended_begins_anew_only_with_another_press(page: Page) -> None:
    page.hold("a", 0.3)
    page.buttons.end()
    page.hold("a", 3.0)
    assert page.after(0.0) is None
    page.buttons.release("a")
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT


def test_a_press_that_never_ends_does(page: Page) -> None:
    moved = 0
    for _ in range(round(3 * LONGEST_S / PERIOD_S)):
        page.hold("a", PERIOD_S)
        moved += page.after(0.0) is not None
    assert moved * PERIOD_S == pytest.approx(LONGEST_S, abs=0.3) and page.refusals == [TOO_LONG]


def test_who_is_gone_is_forgotten(page: Page) -> None:
    def clients() -> Iterable[str]:
        return (f"browser {number}" for number in range(1000))

    for client in clients():
        page.hold(client, PERIOD_S)
    page.after(GAP_S)
    page.hold("a", 0.3)
    assert page.after(0.0) == LEFT and not page.buttons._over

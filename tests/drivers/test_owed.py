"""Late replies of one servo are told from present ones, whatever is lost, as long as they come in their order."""

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from drivers.owed import OVERTAKEN_S, OWED_S, OwedReplies

SIZES = (8, 10, 13, 15)
CYCLE_S = 0.01


class OneServo:
    """Questions to it, and its replies in an adapter that gives them out in their order."""

    def __init__(self) -> None:
        self.owed = OwedReplies()
        self.asked: list[int] = []
        self.held: deque[int] = deque()
        """The questions whose replies are in the adapter."""

    def ask(self, *, lost: bool = False, comes: int = 100) -> int | None:
        """One question, after which so many replies come; the question whose answer was believed."""
        question, now_s = len(self.asked), len(self.asked) * CYCLE_S
        self.owed.forget(now_s)
        self.asked.append(SIZES[self.owed.free({1: SIZES})])
        if not lost:
            self.held.append(question)
        believed = None
        for _ in range(min(comes, len(self.held))):
            size = self.asked[answered := self.held.popleft()]
            if not self.owed.settle(1, size, size == self.asked[question]):
                assert believed is None
                believed = answered
                self.owed.answered((1,))
        if believed is None:
            self.owed.owe(1, self.asked[question], now_s, "silent")
        return believed


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 6)), max_size=150))
def test_only_the_present_answer_is_believed_and_soon_again(cycles: list[tuple[bool, int]]) -> None:
    servo = OneServo()
    for lost, comes in cycles:
        question = len(servo.asked)
        assert servo.ask(lost=lost, comes=comes) in (None, question)
    servo.ask(lost=True)  # whatever is in the adapter comes
    beginning = len(servo.asked)
    believed = servo.ask(), servo.ask()
    assert believed[0] in (None, beginning)
    assert believed[1] == beginning + 1


def test_a_reply_that_may_be_an_old_one_is_not_believed_but_the_next_is() -> None:
    servo = OneServo()
    for _ in SIZES:
        assert servo.ask(lost=True) is None
    assert servo.ask() is None
    assert servo.ask() == len(SIZES) + 1


def test_what_was_overtaken_is_still_known_for_a_while() -> None:
    owed = OwedReplies()
    owed.owe(1, 8, 0.0, "silent")
    owed.answered((1, 2))
    owed.forget(OVERTAKEN_S * 0.9)
    assert owed.free({1: SIZES}) == 1 and not owed.doubtful({1: 8})
    assert owed.settle(1, 8, asked=True) is None
    assert owed.settle(1, 8, asked=False) == "silent"
    assert not owed


def test_what_is_owed_is_forgotten_in_the_end() -> None:
    owed = OwedReplies()
    for now_s, size in ((0.0, 8), (1.0, 10)):
        owed.owe(1, size, now_s, "corrupt")
    owed.forget(OWED_S)
    assert owed.sizes() == {10}
    owed.forget(OWED_S + 1.0)
    assert not owed


def test_a_group_is_asked_for_what_the_fewest_owe_and_then_for_what_was_owed_last() -> None:
    owed = OwedReplies()
    for now_s, place in enumerate((0, 1, 3, 2)):
        owed.owe(1, SIZES[place], now_s, "silent")
    assert owed.free({1: SIZES}) == 2
    owed.owe(2, SIZES[2], 3.0, "silent")
    assert owed.free({1: SIZES, 2: SIZES}) == 3
    assert owed.free({2: SIZES}) == 0

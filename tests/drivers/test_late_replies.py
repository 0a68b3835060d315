"""Late replies of a servo are distinguished from current replies, whatever is lost, as long as replies keep their
order."""

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.late_replies import HELD_S, OPEN_S, LateReplyFilter

SIZES = (8, 10, 13, 15)
CYCLE_S = 0.01


class OneServo:
    """One servo and its requests. An adapter delivers replies in their order."""

    def __init__(self) -> None:
        self.late = LateReplyFilter()
        self.asked: list[int] = []
        self.held: deque[int] = deque()
        """Requests whose replies the adapter holds back."""

    def ask(self, *, lost: bool = False, comes: int = 100) -> int | None:
        """Send a request. After it, at most ``comes`` replies arrive. Return the request whose reply was accepted."""
        question, now_s = len(self.asked), len(self.asked) * CYCLE_S
        self.late.forget(now_s)
        self.asked.append(SIZES[self.late.place({1: SIZES})])
        if not lost:
            self.held.append(question)
        believed = None
        for _ in range(min(comes, len(self.held))):
            size = self.asked[answered := self.held.popleft()]
            if not self.late.match(1, size, size == self.asked[question]):
                assert believed is None
                believed = answered
                self.late.answered(1, now_s)
        if believed is None:
            self.late.add(1, self.asked[question], now_s, "silent")
        return believed


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 6)), max_size=150))
def test_only_the_current_reply_is_accepted_and_soon_again(cycles: list[tuple[bool, int]]) -> None:
    servo = OneServo()
    for lost, comes in cycles:
        question = len(servo.asked)
        assert servo.ask(lost=lost, comes=comes) in (None, question)
    servo.ask(lost=True)  # all replies that the adapter holds back arrive
    beginning = len(servo.asked)
    believed = servo.ask(), servo.ask()
    assert believed[0] in (None, beginning)
    assert believed[1] == beginning + 1


def test_the_oldest_of_many_open_requests_is_answered_first() -> None:
    late = LateReplyFilter()
    late.add(1, 15, 0.0, "silent")
    late.add(1, 10, 0.001, "silent")
    for number in range(2, 1000):
        late.add(1, 15, number * 0.001, "silent")
    assert late.match(1, 15) == "silent"
    assert late.ambiguous({1: 10}), "it was asked after the question that was just answered"


def test_expired_requests_are_not_kept() -> None:
    late = LateReplyFilter()
    for number in range(1000):
        late.add(1, 15, number * 0.01, "silent")
    assert len(late.open[1][15].given_up) == OPEN_S / 0.01


def test_an_ambiguous_reply_is_not_accepted_but_the_next_reply_is() -> None:
    servo = OneServo()
    for _ in SIZES:
        assert servo.ask(lost=True) is None
    assert servo.ask() is None
    assert servo.ask() == len(SIZES) + 1


def test_a_certain_reply_closes_all_earlier_requests_of_its_servo() -> None:
    late = LateReplyFilter()
    late.add(1, 8, 0.0, "silent")
    late.add(2, 8, 0.0, "silent")
    late.add_single(1, 0.0)
    late.answered(1, 0.0)
    late.forget(HELD_S)
    assert late.servos(0.0) == {2} and late.ambiguous({2: 8}) and not late.ambiguous({1: 8, 2: 10})


def test_each_late_reply_returns_how_its_request_was_counted() -> None:
    late = LateReplyFilter()
    for counted in ("silent", "corrupt"):
        late.add(1, 8, 0.0, counted)
    assert [late.match(1, 8) for _ in range(3)] == ["silent", "corrupt", None]


def test_open_requests_are_closed_after_their_time() -> None:
    late = LateReplyFilter()
    for now_s, size in ((0.0, 8), (1.0, 10)):
        late.add(1, size, now_s, "corrupt")
    late.forget(OPEN_S)
    assert late.sizes() == {10}
    late.forget(OPEN_S + 1.0)
    assert not late.open


def test_a_group_is_asked_for_the_size_with_the_fewest_and_latest_open_requests() -> None:
    late = LateReplyFilter()
    for now_s, place in enumerate((0, 1, 3, 2)):
        late.add(1, SIZES[place], now_s, "silent")
    assert late.place({1: SIZES}) == 2
    late.add(2, SIZES[2], 3.0, "silent")
    assert late.place({1: SIZES, 2: SIZES}) == 3
    assert late.place({2: SIZES}) == 0


def test_each_of_several_equal_requests_may_be_answered_late_once() -> None:
    late = LateReplyFilter()
    for counted in ("silent", "silent", "silent", "corrupt"):
        late.add(1, 8, 0.0, counted)
    assert late.open and late.servos(0.0) == {1}
    assert [late.match(1, 8) for _ in range(5)] == ["silent", "silent", "silent", "corrupt", None]
    assert not late.open and late.servos(0.0) == frozenset()


def test_overtaken_requests_are_remembered_for_a_while() -> None:
    late = LateReplyFilter()
    late.add(1, 8, 0.0, "silent")
    late.answered(1, 0.0)
    late.forget(HELD_S * 0.9)
    assert late.place({1: SIZES}) == 1
    assert late.match(1, 8, asked=True) is None
    late.forget(HELD_S * 1.1)
    assert not late.open


def test_only_an_open_size_that_was_not_overtaken_is_ambiguous() -> None:
    late = LateReplyFilter()
    late.add(1, 8, 0.0, "silent")
    assert late.ambiguous({1: 8, 2: 8})
    assert not late.ambiguous({1: 10, 2: 8}) and not late.ambiguous({2: 8}) and not late.ambiguous({})
    late.answered(1, 0.0)
    assert not late.ambiguous({1: 8})
    late.add(1, 8, 0.1, "corrupt")
    assert late.ambiguous({1: 8})
    assert late.match(1, 8, asked=True) == "corrupt"

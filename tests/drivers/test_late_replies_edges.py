"""Edge cases of late replies: single requests, and times just after a limit."""

import math

from drivers.bus.late_replies import HELD_S, OPEN_S, LateReplyFilter


def test_a_reply_to_a_single_request_may_be_late_for_held_s() -> None:
    late = LateReplyFilter()
    late.add_single(1, 5.0)
    assert late.single_until_s(1) == 5.0 + HELD_S
    assert late.single_until_s(2) == -math.inf
    assert late.servos(5.0) == {1}
    assert late.servos(5.0 + HELD_S) == frozenset()


def test_a_request_of_the_same_size_keeps_earlier_requests_open() -> None:
    late = LateReplyFilter()
    late.add(1, 8, 0.0, "silent")
    late.add(1, 8, 1.5, "corrupt")
    late.forget(1.5)
    assert late.match(1, 8) == "silent"
    late.forget(OPEN_S + 1.0)
    assert late.sizes() == {8}
    late.forget(OPEN_S + 1.5)
    assert late.sizes() == frozenset()


def test_a_reply_to_an_overtaken_request_is_recognized_by_its_size() -> None:
    late = LateReplyFilter()
    late.add(1, 8, 0.0, "silent")
    late.answered(1, 0.0)
    assert late.match(1, 8) == "silent"


def test_without_servos_the_first_size_is_chosen() -> None:
    assert LateReplyFilter().place({}) == 0

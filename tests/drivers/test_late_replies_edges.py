"""Late replies at the edges: what a servo that was asked by itself still owes, and times that are just over."""

import math

from drivers.bus.late_replies import HELD_S, OPEN_S, LateReplies


def test_the_answer_to_a_single_question_may_come_for_as_long_as_bytes_are_held() -> None:
    late = LateReplies()
    late.add_single(1, 5.0)
    assert late.single_until_s(1) == 5.0 + HELD_S
    assert late.single_until_s(2) == -math.inf
    assert late.servos(5.0) == {1}
    assert late.servos(5.0 + HELD_S) == frozenset()


def test_a_question_of_the_same_size_keeps_the_earlier_ones_open_as_long_as_itself() -> None:
    late = LateReplies()
    late.add(1, 8, 0.0, "silent")
    late.add(1, 8, 1.5, "corrupt")
    late.forget(1.5)
    assert late.match(1, 8) == "silent"
    late.forget(OPEN_S + 1.0)
    assert late.sizes() == {8}
    late.forget(OPEN_S + 1.5)
    assert late.sizes() == frozenset()


def test_a_reply_to_an_overtaken_question_is_known_where_its_size_was_not_asked_for() -> None:
    late = LateReplies()
    late.add(1, 8, 0.0, "silent")
    late.answered(1, 0.0)
    assert late.match(1, 8) == "silent"


def test_where_nobody_is_asked_the_first_size_will_do() -> None:
    assert LateReplies().place({}) == 0

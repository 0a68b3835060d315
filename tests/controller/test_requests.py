"""What other threads ask of the loop: done once, in turn, in its thread, and never left without an answer."""

import threading

import pytest

from controller.manager.requests import Requests


def test_what_was_asked_is_done_in_turn_when_the_loop_comes_to_it() -> None:
    requests, done = Requests(), list[str]()
    first = requests.ask(lambda: done.append("first"))
    second = requests.ask(lambda: len(done))
    assert not first.done and done == []
    requests.serve()
    assert first.done and second.result() == 1
    requests.serve()
    assert done == ["first"]


def test_an_error_goes_to_who_asked_and_hides_nothing() -> None:
    requests = Requests()
    broken, sound = requests.ask(lambda: 1 // 0), requests.ask(lambda: "sound")
    requests.serve()
    with pytest.raises(ZeroDivisionError):
        broken.result()
    assert sound.result() == "sound"


def test_after_the_end_everybody_is_told() -> None:
    requests = Requests()
    early = requests.ask(lambda: "early")
    requests.end()
    for request in (early, requests.ask(lambda: "late")):
        assert request.done
        with pytest.raises(RuntimeError, match="the control loop has ended"):
            request.result()


def test_requests_of_many_threads_are_all_done_in_the_loops_thread() -> None:
    requests, where = Requests(), list[int]()
    threads = [
        threading.Thread(target=lambda: [requests.ask(lambda: where.append(threading.get_ident())) for _ in range(50)])
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        requests.serve()
    requests.serve()
    assert where == [threading.get_ident()] * 400

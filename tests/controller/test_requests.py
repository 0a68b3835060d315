"""Test that requests from other threads are executed once, in order, in the loop thread, and are always answered."""

import threading

import pytest

from controller.manager.requests import LoopRequests


def test_requests_are_served_in_order_by_the_loop() -> None:
    requests, done = LoopRequests(), list[str]()
    first = requests.ask(lambda: done.append("first"))
    second = requests.ask(lambda: len(done))
    assert not first.done and done == []
    requests.serve()
    assert first.done and second.result() == 1
    requests.serve()
    assert done == ["first"]


def test_an_error_is_raised_to_the_client_of_the_request() -> None:
    requests = LoopRequests()
    broken, sound = requests.ask(lambda: 1 // 0), requests.ask(lambda: "sound")
    requests.serve()
    with pytest.raises(ZeroDivisionError):
        broken.result()
    assert sound.result() == "sound"


def test_requests_after_the_end_are_refused() -> None:
    requests = LoopRequests()
    early = requests.ask(lambda: "early")
    requests.end()
    for request in (early, requests.ask(lambda: "late")):
        assert request.done
        with pytest.raises(RuntimeError, match="the control loop has ended"):
            request.result()


def test_requests_from_many_threads_run_in_the_thread_of_the_loop() -> None:
    requests, where = LoopRequests(), list[int]()
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

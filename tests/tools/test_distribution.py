"""Every test is run by some worker, and none in real time by a worker that has begun to compute."""

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.distribution import ComputingAside, in_real_time


class Worker:
    """What the scheduler talks to instead of a process."""

    def __init__(self) -> None:
        self.queue: list[int] = []
        self.ran: list[str] = []
        self.shutting_down = False
        self.gateway = SimpleNamespace(id="a worker")

    def send_runtest_some(self, indices: list[int]) -> None:
        self.queue.extend(indices)

    def shutdown(self) -> None:
        self.shutting_down = True


def run(tests: list[str], workers: list[Worker], request: pytest.FixtureRequest) -> None:
    """As xdist does it: a worker runs what it was sent but the last one, which it keeps until told there is no more.

    The workers take turns.
    """
    config: Any = SimpleNamespace(
        option=SimpleNamespace(loadscopereorder=False),
        getvalue=lambda name: ["popen"] * len(workers),
        hook=request.config.hook,
    )
    scheduler: Any = ComputingAside(config)
    for worker in workers:
        scheduler.add_node(worker)
        scheduler.add_node_collection(worker, tests)
    scheduler.schedule()
    while ready := [one for one in workers if len(one.queue) > (0 if one.shutting_down else 1)]:
        worker = min(ready, key=lambda one: len(one.ran))
        index = worker.queue.pop(0)
        worker.ran.append(tests[index])
        scheduler.mark_test_complete(worker, index)
    assert all(worker.shutting_down for worker in workers)


FILES = st.lists(st.tuples(st.booleans(), st.integers(1, 4)), min_size=1, max_size=12)


@given(files=FILES, count=st.integers(1, 5))
def test_all_are_run_and_who_computes_does_nothing_else(
    request: pytest.FixtureRequest, files: list[tuple[bool, int]], count: int
) -> None:
    kinds = sorted(files, key=lambda one: not one[0])
    tests = [
        f"tests/{'ros' if real else 'hal'}/test_{number}.py::test_{i}"
        for number, (real, many) in enumerate(kinds)
        for i in range(many)
    ]
    workers = [Worker() for _ in range(count)]
    run(tests, workers, request)
    assert sorted(test for worker in workers for test in worker.ran) == sorted(tests)
    if count == 1:
        return
    for worker in workers:
        kinds_run = [in_real_time(test) for test in worker.ran]
        assert kinds_run == sorted(kinds_run, reverse=True), "computed, and then worked in real time"

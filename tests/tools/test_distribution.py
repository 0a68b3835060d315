"""Tests of the distribution of tests to workers: every test runs, even if workers die, and workers that compute run no
real-time test."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.distribution import ComputingAside, in_real_time
from tests.pages import ROOT
from tests.tiers import long_tests


class Worker:
    """Worker as the scheduler sees it, without a process."""

    def __init__(self) -> None:
        self.queue: list[int] = []
        self.ran: list[str] = []
        self.shutting_down = False
        self.gateway = SimpleNamespace(id="a worker")

    def send_runtest_some(self, indices: list[int]) -> None:
        self.queue.extend(indices)

    def shutdown(self) -> None:
        self.shutting_down = True


def run(
    tests: list[str], workers: list[Worker], request: pytest.FixtureRequest, deaths: frozenset[int] = frozenset()
) -> list[str]:
    """Simulate xdist: a worker runs all tests that it was sent except the last, which it keeps until no more follow.

    The workers take turns. In the turns listed in ``deaths``, one worker dies and is replaced. Return the tests at
    which workers died.
    """
    died: list[str] = []
    turn = 0
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
        turn += 1
        if turn in deaths:
            worker.queue.clear()
            worker.shutting_down = True
            died.append(tests[index])
            assert scheduler.remove_node(worker) == died[-1]
            scheduler.mark_test_pending(died[-1])
            workers.append(Worker())
            scheduler.add_node(workers[-1])
            scheduler.add_node_collection(workers[-1], tests)
            scheduler.schedule()
            continue
        worker.ran.append(tests[index])
        scheduler.mark_test_complete(worker, index)
    assert all(worker.shutting_down for worker in workers)
    return died


FILES = st.lists(st.tuples(st.booleans(), st.integers(1, 4)), min_size=1, max_size=12)


def named(files: list[tuple[bool, int]]) -> list[str]:
    """Return test files that run in real time or not, each with this number of tests."""
    kinds = sorted(files, key=lambda one: not one[0])
    return [
        f"tests/{'ros' if real else 'hal'}/test_{number}.py::test_{i}"
        for number, (real, many) in enumerate(kinds)
        for i in range(many)
    ]


@given(files=FILES, count=st.integers(1, 5))
def test_every_test_runs_and_computing_workers_run_no_waiting_tests(
    request: pytest.FixtureRequest, files: list[tuple[bool, int]], count: int
) -> None:
    tests = named(files)
    workers = [Worker() for _ in range(count)]
    run(tests, workers, request)
    assert sorted(test for worker in workers for test in worker.ran) == sorted(tests)
    if count == 1:
        return
    for worker in workers:
        kinds_run = [in_real_time(test) for test in worker.ran]
        assert kinds_run == sorted(kinds_run, reverse=True), "computed, and then worked in real time"


@given(files=FILES, count=st.integers(1, 4), deaths=st.frozensets(st.integers(1, 30), max_size=5))
def test_other_workers_take_over_from_dead_workers_and_repeat_their_current_test(
    request: pytest.FixtureRequest, files: list[tuple[bool, int]], count: int, deaths: frozenset[int]
) -> None:
    tests = named(files)
    workers = [Worker() for _ in range(count)]
    died = Counter(run(tests, workers, request, deaths))
    assert max(died.values(), default=0) <= 2
    assert sorted(test for worker in workers for test in worker.ran) == sorted(t for t in tests if died[t] < 2)


def test_every_long_test_exists() -> None:
    """A long test that was renamed would run in full again."""
    for test in long_tests():
        path, *_, name = test.split("::")
        defined = "TestCase" if name == "runTest" else f"def {name}("
        assert defined in (ROOT / path).read_text(), test

"""Tests of workers: results in the order of the seeds, interruption, and reports of killed processes."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from types import ModuleType
from typing import Any

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servoloop.campaign import supervised, workers
from servoloop.campaign.campaign import campaign, run_seed, schedule_of
from servoloop.campaign.invariants import Violation
from servoloop.campaign.ray_workers import LOCAL, RayError, on_ray
from servoloop.campaign.run import RunReport
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.supervised import ON_TIME, Loss, Supervisor, WorkerError
from servoloop.campaign.workers import CHUNK, TASKS_AHEAD, in_order, in_processes, run_all
from servoloop.simulation.schedule import Schedule
from tests.complaint import complaint

ROOT = Path(__file__).parents[2]
RAY = find_spec("ray") is not None
SCENARIO = Scenario(seconds=1.0, faults=2, within_s=0.8)


def with_ray(test: Any) -> Any:
    """Mark a test that needs a local Ray, which takes ten seconds to start and stop."""
    reason = "Ray is not installed: pip install 'servoloop[ray]'"
    return pytest.mark.slow(pytest.mark.timeout(240)(pytest.mark.skipif(not RAY, reason=reason)(test)))


def never() -> bool:
    return False


class OtherOrder:
    """Workers that complete their tasks in a random order."""

    def __init__(self, order: Callable[[list[int]], int]) -> None:
        self._order = order
        self._open: list[tuple[Future[list[int]], range]] = []
        self.most = 0

    def submit(self, chunk: range) -> "Future[list[int]]":
        future: Future[list[int]] = Future()
        self._open.append((future, chunk))
        self.most = max(self.most, len(self._open))
        return future

    def work(self) -> bool:
        """Complete one task. ``in_order`` calls this function to find out whether to stop."""
        if self._open:
            future, chunk = self._open.pop(self._order(list(range(len(self._open)))))
            future.set_result([seed * seed for seed in chunk])
        return False


@pytest.fixture(scope="module")
def without_waiting() -> Iterator[None]:
    """Poll without waiting, because these workers do their work only when they are polled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "POLL_S", 0.0)
        yield


@given(seeds=st.integers(0, 120), first=st.integers(0, 9), many=st.integers(1, 4), data=st.data())
def test_results_come_in_the_order_of_the_seeds_and_few_are_kept(
    without_waiting: None, seeds: int, first: int, many: int, data: st.DataObject
) -> None:
    there = OtherOrder(lambda open_tasks: data.draw(st.sampled_from(open_tasks)))
    requested = range(first, first + seeds)
    assert list(in_order(there.submit, requested, many, there.work)) == [seed * seed for seed in requested]
    assert there.most <= many * TASKS_AHEAD


def test_no_further_task_is_submitted_after_a_stop() -> None:
    handed: list[range] = []

    def submit(chunk: range) -> "Future[list[int]]":
        handed.append(chunk)
        future: Future[list[int]] = Future()
        future.set_result(list(chunk))
        return future

    seen: list[int] = []
    for result in in_order(submit, range(1000), 1, lambda: len(seen) >= 2 * CHUNK):
        seen.append(result)
    assert seen == [*range(2 * CHUNK)]
    assert len(handed) <= 2 + TASKS_AHEAD


def test_a_huge_number_of_seeds_starts_at_once() -> None:
    """The tasks of all seeds would not fit into memory."""

    def submit(chunk: range) -> "Future[list[int]]":
        future: Future[list[int]] = Future()
        future.set_result(list(chunk))
        return future

    assert next(in_order(submit, range(2**62), 1, never)) == 0


def kill_at_7(seed: int) -> int:
    if seed == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


def lost(seed: int, loss: Loss) -> int:
    assert not loss.hung and loss.text == "its process was ended by SIGKILL"
    return -seed


class Replies:
    """Supervisor that returns these results one after the other."""

    def __init__(self, *results: int | Loss) -> None:
        self._results = list(results)
        self.seeds: list[int] = []

    def run(self, run: object, seed: int) -> int | Loss:
        self.seeds.append(seed)
        return self._results.pop(0)


DIED = Loss(False, 0.5, "its process was ended by SIGKILL")
HUNG = Loss(True, 0.5, "its simulated time stood still")


@pytest.mark.parametrize(
    ("results", "reported", "seeds"),
    [
        ((3, 4), [3, 4], [3, 4]),
        ((DIED, 3, 4), [3, 4], [3, 3, 4]),
        ((DIED, DIED, 4), ["its process was ended by SIGKILL", 4], [3, 3, 4]),
        ((HUNG, 4), ["its simulated time stood still", 4], [3, 4]),
        ((DIED, HUNG, 4), ["its simulated time stood still", 4], [3, 3, 4]),
    ],
)
def test_a_run_whose_process_ends_is_repeated_once_but_a_run_that_hangs_is_not(
    results: tuple[int | Loss, ...], reported: list[Any], seeds: list[int]
) -> None:
    replies: Any = Replies(*results)
    assert run_all(replies, abs, lambda seed, loss: loss.text, range(3, 5)) == reported
    assert replies.seeds == seeds


@pytest.mark.slow
def test_a_killed_run_is_the_only_lost_result_and_keeps_its_place() -> None:
    assert list(in_processes(kill_at_7, lost, range(20), 2, never)) == [*range(7), -7, *range(8, 20)]


def test_after_a_stop_no_task_starts_another_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """If another run were started, a task whose runs hang would continue for minutes after Ctrl-C."""
    begun, goes_on, ran = Event(), Event(), list[int]()

    class Waits(Supervisor):
        def run(self, run: Any, item: Any) -> Any:
            ran.append(item)
            begun.set()
            goes_on.wait()
            return item

    def stop() -> bool:
        return begun.is_set()

    class Ending(ThreadPoolExecutor):
        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            goes_on.set()
            super().shutdown(wait, cancel_futures=cancel_futures)

    monkeypatch.setattr(workers, "Supervisor", Waits)
    monkeypatch.setattr(workers, "ThreadPoolExecutor", Ending)
    assert list(in_processes(abs, lost, range(20), 1, stop)) == []
    assert ran == [0]


def killed_at(*seeds: int) -> Any:
    """Return a replacement of ``in_processes`` that loses the runs of these seeds."""

    def runs(run: object, lost: Callable[[int, Loss], RunReport], requested: range, *_: object) -> Iterator[RunReport]:
        for seed in requested:
            yield lost(seed, DIED) if seed in seeds else RunReport(Schedule(seed=seed), (), 0, "", 1.0, None)

    return runs


def test_a_campaign_continues_after_killed_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servoloop.campaign.campaign.in_processes", killed_at(0, 1, 3, 4, 9))
    reports = list(campaign(SCENARIO, range(10), 2))
    assert [report.seed for report in reports] == [*range(10)]
    killed = [report for report in reports if report.violations]
    assert [report.seed for report in killed] == [0, 1, 3, 4, 9]
    assert killed[2].violations == (Violation("not killed", 0.5, "its process was ended by SIGKILL"),)
    assert killed[2].schedule == schedule_of(SCENARIO, 3)


def test_a_campaign_ends_when_the_processes_of_three_seeds_in_a_row_are_killed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servoloop.campaign.campaign.in_processes", killed_at(2, 4, 5, 6, 7))
    seen: list[int] = []
    with pytest.raises(WorkerError) as ended:
        seen.extend(report.seed for report in campaign(SCENARIO, range(10), 2))
    assert str(ended.value) == (
        "the processes of 3 consecutive seeds were killed, most recently the process of seed 6 "
        "(its process was ended by SIGKILL). If memory ran out, use fewer processes: set --jobs"
    )
    (tmp_path / "scenario.yaml").write_text("{seconds: 1.0, faults: 2, within_s: 0.8}")
    words = ("--scenario", str(tmp_path / "scenario.yaml"), "--seeds", "10", "--out", str(tmp_path))
    assert "3 consecutive seeds were killed" in complaint(capsys, monkeypatch, "campaign", *words)
    assert (tmp_path / "not-killed-seed-2.yaml").exists()
    assert "Interrupted: 7 of 10 runs were completed." in (tmp_path / "report.html").read_text()


def loops_at_7(seed: int) -> int:
    if seed == 7:
        signal.pthread_sigmask(
            signal.SIG_BLOCK, {supervised.SIGNAL}
        )  # The loop ignores the signal, like an endless loop in C.
        ON_TIME.get()(1.25)  # type: ignore[misc]
        while True:
            pass
    if seed == 8:
        raise WorkerError("seed 8")
    if seed == 9:
        sys.exit(3)
    return seed


@pytest.mark.slow
def test_a_supervisor_replaces_a_process_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    supervisor = Supervisor()
    assert supervisor.run(loops_at_7, 6) == 6
    with monkeypatch.context() as patch:
        patch.setattr(supervised, "POLL_S", 0.01)
        patch.setattr(supervised, "STANDS_S", 0.3)
        patch.setattr(supervised, "GRACE_S", 0.2)
        hung = supervisor.run(loops_at_7, 7)
    assert hung == Loss(True, 1.25, "its simulated time did not advance for 0.3 s of real time")
    with pytest.raises(WorkerError, match="seed 8"):
        supervisor.run(loops_at_7, 8)
    assert supervisor.run(loops_at_7, 9) == Loss(False, 0.0, "its process ended with status 3")
    assert supervisor.run(loops_at_7, 10) == 10
    supervisor.close()
    supervisor.close()


def no_loss(seed: int, loss: Loss) -> RunReport:
    raise AssertionError(f"seed {seed} is lost: {loss.text}")


def killed_once(marker: Path, victim: int, scenario: Scenario, seed: int) -> RunReport:
    """Run a seed. The process of the chosen run is killed the first time."""
    if seed == victim and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return run_seed(scenario, seed)


@with_ray
def test_a_local_ray_returns_the_same_reports_even_if_a_worker_is_killed(tmp_path: Path) -> None:
    marker, seeds = tmp_path / "killed", range(3, 18)
    run = partial(killed_once, marker, 9, SCENARIO)
    assert list(on_ray(run, no_loss, seeds, LOCAL, 2, never)) == list(campaign(SCENARIO, seeds, 0))
    assert marker.exists(), "no worker was killed"


@with_ray
def test_a_run_killed_on_ray_is_the_only_lost_result_and_keeps_its_place() -> None:
    assert list(on_ray(kill_at_7, lost, range(6, 9), LOCAL, 1, never)) == [6, -7, 8]


def kill_parent(seed: int) -> int:
    os.kill(os.getppid(), signal.SIGKILL)
    return seed


@with_ray
def test_a_task_whose_ray_worker_is_always_killed_ends_the_campaign() -> None:
    with pytest.raises(WorkerError, match="a Ray worker was killed 4 times"):
        list(on_ray(kill_parent, lost, range(6, 9), LOCAL, 1, never))


def test_a_missing_ray_is_reported_with_the_command_that_installs_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{seconds: 0.5}")
    monkeypatch.setitem(sys.modules, "ray", None)
    words = ("campaign", "--scenario", str(scenario), "--ray", "local", "--out", str(tmp_path))
    assert "-m pip install" in complaint(capsys, monkeypatch, *words)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("127.0.0.1:1", r"cannot connect to a Ray cluster at 127\.0\.0\.1:1: .*refused"),
        ("the cluster", r"the address must be HOST:PORT, such as 10\.0\.0\.1:6379, or local"),
    ],
)
def test_an_address_without_a_cluster_is_refused(monkeypatch: pytest.MonkeyPatch, address: str, words: str) -> None:
    monkeypatch.setitem(sys.modules, "ray", ModuleType("ray"))  # The address is not used before it answers.
    with pytest.raises(RayError, match=words):
        list(on_ray(kill_at_7, lost, range(3), address, 1, never))


@pytest.mark.slow
def test_ctrl_c_ends_the_processes_and_reports_the_completed_runs(tmp_path: Path) -> None:
    """This test uses real time. The whole process group receives the signal, as from a terminal."""
    (tmp_path / "scenario.yaml").write_text("{seconds: 0.5, faults: 1, within_s: 0.3}")
    words = ["campaign", "--scenario", "scenario.yaml", "--seeds", "100000", "--jobs", "2"]
    command = [sys.executable, "-m", "servoloop", *words]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        children: list[psutil.Process] = []
        while (
            process.poll() is None and len(children) < 3
        ):  # These are two workers and the resource tracker of multiprocessing.
            children = psutil.Process(process.pid).children(recursive=True)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=100)
    assert process.returncode == 130, err
    assert "Traceback" not in err and "of 100000 runs were completed and are reported" in err
    assert "Interrupted: " in (tmp_path / "out" / "campaign" / "report.html").read_text()
    assert "report: out/campaign/report.html" in out
    _, left = psutil.wait_procs(children, timeout=20)
    assert not [child for child in left if child.status() != psutil.STATUS_ZOMBIE]

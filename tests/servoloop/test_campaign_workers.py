"""Workers of a campaign: order of the results, end on request, and killed workers."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servoloop.campaign import workers
from servoloop.campaign.campaign import Scenario, campaign, run_seed
from servoloop.campaign.ray_workers import LOCAL, RayError, on_ray
from servoloop.campaign.run import RunReport
from servoloop.campaign.workers import CHUNK, TASKS_AHEAD, WorkerError, in_order, in_processes
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
    """Workers that complete their tasks in another order."""

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
        """Complete one task. It is called when ``in_order`` checks whether to stop."""
        if self._open:
            future, chunk = self._open.pop(self._order(list(range(len(self._open)))))
            future.set_result([seed * seed for seed in chunk])
        return False


@pytest.fixture(scope="module")
def without_waiting() -> Iterator[None]:
    """Remove the waits for workers, because these workers only work when they are polled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "LOOK_S", 0.0)
        yield


@given(seeds=st.integers(0, 120), first=st.integers(0, 9), many=st.integers(1, 4), data=st.data())
def test_results_come_in_the_order_of_the_seeds_and_few_are_kept(
    without_waiting: None, seeds: int, first: int, many: int, data: st.DataObject
) -> None:
    there = OtherOrder(lambda open_ones: data.draw(st.sampled_from(open_ones)))
    asked = range(first, first + seeds)
    assert list(in_order(there.submit, asked, many, there.work)) == [seed * seed for seed in asked]
    assert there.most <= many * TASKS_AHEAD


def test_after_a_stop_request_no_more_seeds_are_started() -> None:
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


def kill_at_7(seed: int) -> int:
    if seed == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


@pytest.mark.slow
def test_a_killed_worker_process_is_reported() -> None:
    with pytest.raises(WorkerError, match="was killed, perhaps for want of memory: take fewer, with --jobs"):
        list(in_processes(kill_at_7, range(20), 1, never))


def killed_once(marker: Path, victim: int, scenario: Scenario, seed: int) -> RunReport:
    """Run a seed, but kill the worker of one seed at its first attempt."""
    if seed == victim and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return run_seed(scenario, seed)


@with_ray
def test_a_local_ray_gives_the_same_reports_though_a_worker_is_killed(tmp_path: Path) -> None:
    marker, seeds = tmp_path / "killed", range(3, 18)
    run = partial(killed_once, marker, 9, SCENARIO)
    assert list(on_ray(run, seeds, LOCAL, 2, never)) == list(campaign(SCENARIO, seeds, 1))
    assert marker.exists(), "nobody was killed"


@with_ray
def test_a_task_whose_worker_is_always_killed_ends_the_campaign() -> None:
    with pytest.raises(WorkerError, match="killed again and again"):
        list(on_ray(kill_at_7, range(6, 9), LOCAL, 1, never))


def test_a_missing_ray_is_reported_with_the_command_to_install_it(
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
        ("127.0.0.1:1", r"no Ray cluster at 127\.0\.0\.1:1: .*refused"),
        ("the cluster", r"an address is HOST:PORT, such as 10\.0\.0\.1:6379, or local"),
    ],
)
def test_an_address_without_a_cluster_is_reported(monkeypatch: pytest.MonkeyPatch, address: str, words: str) -> None:
    monkeypatch.setitem(sys.modules, "ray", ModuleType("ray"))  # must not ask for a cluster before an address answers
    with pytest.raises(RayError, match=words):
        list(on_ray(kill_at_7, range(3), address, 1, never))


@pytest.mark.slow
def test_ctrl_c_ends_the_processes_and_reports_the_results(tmp_path: Path) -> None:
    """The whole process group gets the signal, as from a terminal. This test runs in real time."""
    (tmp_path / "scenario.yaml").write_text("{seconds: 0.5, faults: 1, within_s: 0.3}")
    words = ["campaign", "--scenario", "scenario.yaml", "--seeds", "100000", "--jobs", "2"]
    command = [sys.executable, "-m", "servoloop", *words]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        children: list[psutil.Process] = []
        while process.poll() is None and len(children) < 3:  # two workers, and multiprocessing's resource tracker
            children = psutil.Process(process.pid).children(recursive=True)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=100)
    assert process.returncode == 130, err
    assert "Traceback" not in err and "of 100000 runs were done, and are reported" in err
    assert "Interrupted: " in (tmp_path / "out" / "campaign" / "report.html").read_text()
    assert "report: out/campaign/report.html" in out
    _, left = psutil.wait_procs(children, timeout=20)
    assert not [child for child in left if child.status() != psutil.STATUS_ZOMBIE]

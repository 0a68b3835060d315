"""Runs on a Ray cluster, or on a Ray that is started on this machine for them."""

import os
import socket
import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Final

from drivers.errors import DriverError
from servoloop.campaign.supervised import RUNS_OF_A_PROCESS, Supervisor, WorkerError
from servoloop.campaign.workers import CHUNK, Lost, Run, Stop, T, in_order, run_all
from servoloop.extras import install_command

LOCAL: Final = "local"
"""The address that starts a Ray on this machine."""
STORE_BYTES: Final = 100_000_000
"""Memory for results in flight, close to the least that Ray takes: reports have a few kilobytes."""
REACH_S: Final = 5.0
TRIES_AGAIN: Final = 3
"""So often a task is run again whose worker was killed."""


class RayError(DriverError):
    """Ray is not installed, or no cluster answers."""


def on_ray(
    run: Run[T], lost: Lost[T], seeds: range, address: str, processes: int, stop: Stop
) -> Generator[T, None, None]:
    """What the runs of all seeds return, in the order of the seeds, until ``stop``.

    ``processes``: of a local Ray; a cluster has as many as it says. Each of Ray's workers supervises a process for its
    runs: only this process ends if a run hangs or is killed. The task of a worker of Ray that is killed is run again.
    Raises RayError, and WorkerError where the same task's worker is killed time and again.
    """
    ray = _ray()
    with _connected(ray, address, processes) as workers:
        task = ray.remote(max_calls=RUNS_OF_A_PROCESS // CHUNK, max_retries=TRIES_AGAIN)(_run_there).remote
        try:
            yield from in_order(lambda chunk: task(run, lost, chunk).future(), seeds, workers, stop)
        except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError) as error:
            raise WorkerError(f"Ray's workers are killed again and again: {error}") from None


def _ray() -> Any:
    try:
        import ray
    except ImportError:
        raise RayError(f"--ray needs Ray, and Python finds none: {install_command('ray')}") from None
    return ray


@contextmanager
def _connected(ray: Any, address: str, processes: int) -> Iterator[int]:
    """Connect, and yield how many runs the cluster can do at a time."""
    try:
        if address == LOCAL:
            _start(ray, processes)
        else:
            _reach(address)
            ray.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError) as error:
        token = "if it asks for a token, set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN"
        raise RayError(f"no Ray cluster at {address}: {error}; {token}") from None
    try:
        yield max(1, int(ray.cluster_resources().get("CPU", 1)))
    finally:
        ray.shutdown()


def _reach(address: str) -> None:
    """Connect once, which tells at once that nobody is there: Ray tries for minutes. Raises OSError and ValueError."""
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isdecimal()):
        raise ValueError(f"an address is HOST:PORT, such as 10.0.0.1:6379, or {LOCAL}")
    socket.create_connection((host, int(port)), REACH_S).close()


def _start(ray: Any, processes: int) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray tells its makers otherwise
    ray.init(
        address=LOCAL,
        num_cpus=processes,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
        object_store_memory=STORE_BYTES,
        # a container's /dev/shm is often smaller than the store
        _plasma_directory=tempfile.gettempdir(),
    )


def _run_there(run: Any, lost: Any, seeds: range) -> Any:
    """A worker's task, there."""
    return run_all(_supervisor(), run, lost, seeds)


@cache
def _supervisor() -> Supervisor:
    """The supervisor of a worker's process."""
    return Supervisor()

"""Execute the runs of a campaign on a Ray cluster, or on a local Ray instance that is started for the campaign."""

import os
import socket
import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Final

from drivers.driver_errors import DriverError
from servoloop.campaign.supervised import RUNS_OF_A_PROCESS, Supervisor, WorkerError
from servoloop.campaign.workers import CHUNK, Lost, Run, Stop, T, in_order, run_all
from servoloop.extras import require_extras

LOCAL: Final = "local"
"""Address that requests a new Ray instance on this machine."""
STORE_BYTES: Final = 100_000_000
"""Size of the object store in bytes, close to the minimum that Ray accepts, because a report has only a few
kilobytes."""
REACH_S: Final = 5.0
"""Timeout for connecting to a cluster, in seconds."""
RETRIES: Final = 3
"""Maximum number of times a task is repeated after its worker is killed."""


class RayError(DriverError):
    """Ray is not installed or the cluster does not respond."""


def on_ray(
    run: Run[T], lost: Lost[T], seeds: range, address: str, processes: int, stop: Stop
) -> Generator[T, None, None]:
    """Run the seeds on Ray and yield their results in seed order.

    Each Ray worker supervises one process that executes its runs. If a run hangs or is killed, only that process ends.
    If a Ray worker is killed, its task is repeated.

    Args:
        run: Function that runs a seed.
        lost: Function that returns the result of a seed whose run was lost.
        seeds: The seeds.
        address: Address of a Ray cluster, or ``local``.
        processes: Number of processes of a local Ray instance. A cluster determines this number itself.
        stop: Function that returns whether to stop.

    Raises:
        ExtraError: Ray is not installed.
        RayError: The cluster does not respond.
        WorkerError: The Ray worker of one task is killed repeatedly.
    """
    ray = _ray()
    with _connected(ray, address, processes) as workers:
        task = ray.remote(max_calls=RUNS_OF_A_PROCESS // CHUNK, max_retries=RETRIES)(_run_task).remote
        try:
            yield from in_order(lambda chunk: task(run, lost, chunk).future(), seeds, workers, stop)
        except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError) as error:
            raise WorkerError(f"a Ray worker was killed {RETRIES + 1} times: {error}") from None


def _ray() -> Any:
    require_extras("--ray", "ray")
    import ray

    return ray


@contextmanager
def _connected(ray: Any, address: str, processes: int) -> Iterator[int]:
    """Connect to Ray and yield the number of runs that it can execute at the same time."""
    try:
        if address == LOCAL:
            _start(ray, processes)
        else:
            _reach(address)
            ray.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError) as error:
        token = "If the cluster needs a token, set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN."
        raise RayError(f"cannot connect to a Ray cluster at {address}: {error}. {token}") from None
    try:
        yield max(1, int(ray.cluster_resources().get("CPU", 1)))
    finally:
        ray.shutdown()


def _reach(address: str) -> None:
    """Check that a program responds at this address, because Ray itself retries for minutes.

    Raises:
        OSError: Nothing responds at the address.
        ValueError: The address has an invalid format.
    """
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isdecimal()):
        raise ValueError(f"the address must be HOST:PORT, such as 10.0.0.1:6379, or {LOCAL}")
    socket.create_connection((host, int(port)), REACH_S).close()


def _start(ray: Any, processes: int) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # By default, Ray sends usage data to its developers.
    ray.init(
        address=LOCAL,
        num_cpus=processes,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
        object_store_memory=STORE_BYTES,
        # In containers, /dev/shm is often smaller than the store.
        _plasma_directory=tempfile.gettempdir(),
    )


def _run_task(run: Any, lost: Any, seeds: range) -> Any:
    """Execute one task in a Ray worker."""
    return run_all(_supervisor(), run, lost, seeds)


@cache
def _supervisor() -> Supervisor:
    """Return the supervisor of this Ray worker."""
    return Supervisor()

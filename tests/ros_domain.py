"""A ROS domain of its own for every test run, so that two runs on a machine do not meet."""

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DOMAINS = range(1, 98, 4)
"""Some tests use the two behind theirs too; from 102 on they can meet the ports that Linux hands out."""


@contextmanager
def free_domain() -> Iterator[int]:
    """One that no other run on this machine has: the lock on its file ends with the process, however that ends."""
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        with Path(tempfile.gettempdir(), f"servoloop-tests-of-{os.getuid()}-ros-domain-{domain}").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError("every ROS domain is in use by another test run on this machine")


@pytest.fixture(scope="session")
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The domain of this run, set in the environment; the processes that a test starts inherit it."""
    with free_domain() as domain, pytest.MonkeyPatch.context() as patch:
        settings = {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(tmp_path_factory.mktemp("ros_log")),
        }
        for name, value in settings.items():
            patch.setenv(name, value)
        yield domain

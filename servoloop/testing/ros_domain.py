"""A ROS domain of its own for every test run, so that two runs on a machine do not meet."""

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from nodes.discovery import stay_on_this_machine

DOMAINS = range(1, 98, 4)
"""From 102 on they can meet the ports that Linux hands out; a run may use the next two as well."""


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


@contextmanager
def own_domain(settings: Mapping[str, str]) -> Iterator[int]:
    """A free domain on this machine alone, in the environment with these ``settings`` until the end of the block."""
    with free_domain() as domain:
        said = {"ROS_DOMAIN_ID": str(domain), **settings}
        stay_on_this_machine(said)
        before = {name: os.environ.get(name) for name in said}
        os.environ.update(said)
        try:
            yield domain
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value

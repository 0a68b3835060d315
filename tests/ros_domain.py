"""A ROS domain of its own for every test run, so that two runs on a machine do not meet."""

from collections.abc import Iterator

import pytest

from nodes.discovery import stay_on_this_machine
from servoloop.testing.ros_domain import own_domain


@pytest.fixture(scope="session")
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The domain of this run, set in the environment; the processes that a test starts inherit it."""
    log = tmp_path_factory.mktemp("ros_log")
    settings = {"ROS_LOG_DIR": str(log)}
    stay_on_this_machine(settings)  # as the programs under test do
    with own_domain(settings) as domain:
        yield domain

"""A ROS domain of its own for every test run, so that two runs on a machine do not meet."""

from collections.abc import Iterator

import pytest

from servoloop.testing.processes import own_domain


@pytest.fixture(scope="session")
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The domain of this run, set in the environment; the processes that a test starts inherit it."""
    log = tmp_path_factory.mktemp("ros_log")
    with own_domain({"ROS_LOG_DIR": str(log)}) as domain:
        yield domain

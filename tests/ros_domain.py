"""A separate ROS domain for every test run, so that two runs on one machine do not communicate."""

from collections.abc import Iterator

import pytest

from servoloop.testing.processes import own_domain


@pytest.fixture(scope="session")
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Yield the domain of this run. The domain is set in the environment, which child processes inherit."""
    log = tmp_path_factory.mktemp("ros_log")
    with own_domain({"ROS_LOG_DIR": str(log)}) as domain:
        yield domain

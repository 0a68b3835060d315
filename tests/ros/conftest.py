"""A ROS domain of its own for every test run, so that two runs on a machine do not meet."""

import random
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session")
def ros_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The domain of this run, set in the environment; the processes that a test starts inherit it."""
    domain = random.randint(1, 100)  # 102 and up can meet the ports that Linux hands out
    settings = {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path_factory.mktemp("ros_log")),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setenv(name, value)
        yield domain

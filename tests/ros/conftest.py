"""Marker of the tests over ROS, and the stack and client that the tests of the controller manager share."""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.manager_client import ManagerClient
    from tests.ros.stack_process import StackProcess

collect_ignore_glob = [] if find_spec("rclpy") else ["test_*.py"]


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark every test of this folder."""
    item.add_marker(pytest.mark.ros)


# Fixtures for the tests of the controller manager. Modules that need a different stack or more cleanup have their own
# fixtures.


@pytest.fixture(scope="module")
def namespace() -> str:
    """Return the namespace of the stack. Some modules replace it, to run in several namespaces."""
    return ""


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory, namespace: str) -> Iterator["StackProcess"]:
    from tests.ros.manager_bench import manager_stack

    with manager_stack(tmp_path_factory.mktemp("stack"), namespace) as stack:
        yield stack


@pytest.fixture(scope="module")
def connected(stack: "StackProcess", namespace: str) -> Iterator["ManagerClient"]:
    from tests.ros.manager_client import manager_client

    with manager_client(namespace) as client:
        yield client


@pytest.fixture
def client(connected: "ManagerClient") -> Iterator["ManagerClient"]:
    """Provide the client, with the stack in its initial state."""
    from tests.ros.manager_bench import restore

    yield connected
    restore(connected)

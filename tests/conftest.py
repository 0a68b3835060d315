"""The same examples in every run, none too slow on a busy machine, and an order that keeps both cores busy."""

import pytest
from hypothesis import settings

from tests.ros_domain import ros_domain

__all__ = ["ros_domain"]  # one for all folders: a second one would end in the middle of the first

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests over ROS come first: they take longest, and the short ones are left to even two workers out."""
    items.sort(key=lambda item: "ros" not in item.keywords)

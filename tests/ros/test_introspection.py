"""Topics of the controller manager with the values of all interfaces and the times of the loop."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pal_statistics_msgs")

import rclpy
from pal_statistics_msgs.msg import Statistics, StatisticsNames, StatisticsValues
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from servoloop.stack.shipped_files import CONTROLLERS
from tests.ros.stack_process import running, until

INTERFACES, TIMES = "/controller_manager/introspection_data", "/controller_manager/statistics"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TOPICS = [
    (f"{topic}/{name}", kind, qos)
    for topic in (INTERFACES, TIMES)
    for name, kind, qos in (
        ("full", Statistics, 10),
        ("names", StatisticsNames, LATCHED),
        ("values", StatisticsValues, 10),
    )
]


@pytest.fixture
def heard(ros_domain: int, tmp_path: Path) -> Iterator[dict[str, Any]]:
    """Return the first message of each topic of a stack on the mock."""
    controllers = tmp_path / "controllers.yaml"
    setting = "ros__parameters:\n    publish_introspection: true\n"
    controllers.write_text(CONTROLLERS.read_text().replace("ros__parameters:\n", setting, 1))
    found: dict[str, Any] = {}
    with running(tmp_path, "--hardware", "mock", "--controllers", str(controllers)):
        rclpy.init()
        node, executor = rclpy.create_node("plot"), SingleThreadedExecutor()
        executor.add_node(node)
        for topic, kind, qos in TOPICS:
            node.create_subscription(kind, topic, lambda message, topic=topic: found.setdefault(topic, message), qos)

        def complete() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return len(found) == len(TOPICS)

        until(complete)
        yield found
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def test_interfaces_and_times_have_names_and_values(heard: dict[str, Any]) -> None:
    for topic in (INTERFACES, TIMES):
        names, values, full = (heard[f"{topic}/{part}"] for part in ("names", "values", "full"))
        assert len(names.names) == len(values.values) == len(set(names.names))
        assert [variable.name for variable in full.statistics] == list(names.names)
        assert names.names_version == values.names_version and values.header.stamp.sec > 0
    states = dict(zip(heard[f"{INTERFACES}/names"].names, heard[f"{INTERFACES}/values"].values, strict=True))
    assert states["state_interface.joint1/position"] == states["command_interface.joint1/position"] == 0.0
    times = {variable.name: variable.value for variable in heard[f"{TIMES}/full"].statistics}
    assert 0.0 < times["controller_manager.total_time/average"] < 50_000.0
    assert math.isfinite(times["controller_manager.periodicity/average"])

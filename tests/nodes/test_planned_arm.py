"""A job that needs a motion planner waits until the services of the planner are available, because a request sent
earlier would be lost."""

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("moveit_msgs")

import rclpy
from moveit_msgs.srv import GetPlanningScene
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from nodes.pick_place.planned_arm import PlannedArm
from pick_place.job import JobOutcome
from pick_place.pose_settings import PoseSettings

pytestmark = pytest.mark.ros
LATE_S = 0.5


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    rclpy.init()
    node = Node("job")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def outcome_of_removal(node: Node, server_timeout_s: float) -> JobOutcome:
    """Remove an object that does not exist. This removal requests only the current scene from the planner."""
    arm = PlannedArm(node, PoseSettings(server_timeout_s=server_timeout_s))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    task = executor.create_task(arm.remove_object)
    try:
        executor.spin_until_future_complete(task, timeout_sec=10.0)
        outcome: JobOutcome = task.result()
    finally:
        executor.shutdown()
    return outcome


def test_a_service_that_appears_late_receives_the_request(node: Node) -> None:
    def serve() -> None:
        late.cancel()
        node.create_service(GetPlanningScene, "get_planning_scene", _empty_scene)

    late = node.create_timer(LATE_S, serve)
    assert outcome_of_removal(node, server_timeout_s=5.0) == JobOutcome(True)


def test_a_service_that_does_not_appear_is_named(node: Node) -> None:
    outcome = outcome_of_removal(node, server_timeout_s=0.2)
    assert outcome == JobOutcome(False, "the service /get_planning_scene is not available (waited 0.2 s)")


def _empty_scene(request: Any, response: Any) -> Any:
    return response

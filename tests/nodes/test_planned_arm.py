"""A job that needs a motion planner waits until the services of the planner are available, because a request sent
earlier would be lost. A job that is canceled begins no further motion."""

from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("moveit_msgs")

import rclpy
from moveit_msgs.srv import GetCartesianPath, GetPlanningScene
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

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
    return outcome_of(node, PlannedArm(node, PoseSettings(server_timeout_s=server_timeout_s)).remove_object)


def outcome_of(node: Node, work: Callable[[], Any]) -> JobOutcome:
    """Spin the node until the work is done, and return its outcome."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    task = executor.create_task(work)
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


@pytest.mark.parametrize("stops_at", ["is_ready", "call"])
def test_a_stop_while_a_line_is_computed_moves_nothing(
    node: Node, monkeypatch: pytest.MonkeyPatch, stops_at: str
) -> None:
    """The stop arrives just before the request, or in the same wake-up of the executor as the response."""
    calls: list[Any] = []

    def is_ready() -> bool:
        if stops_at == "is_ready":
            arm.stop()
        return True

    def call(request: Any) -> Future:
        calls.append(request)
        arm.stop()
        answer = Future()
        answer.set_result(GetCartesianPath.Response(fraction=1.0))
        return answer

    client = SimpleNamespace(service_is_ready=is_ready, call_async=call, remove_pending_request=lambda _: None)
    monkeypatch.setattr(node, "create_client", lambda *_: client)
    settings = PoseSettings(server_timeout_s=0.2)
    arm = PlannedArm(node, settings)
    # Without an action server, a motion that begins fails with a reason.
    assert outcome_of(node, partial(arm.move_straight, settings.pick)) == JobOutcome(False)
    assert len(calls) == (stops_at == "call")


def _empty_scene(request: Any, response: Any) -> Any:
    return response

"""Goals of the planning server that are stopped before their motion begins, without a middleware."""

from collections.abc import Awaitable, Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from moveit_msgs.action import ExecuteTrajectory
from moveit_msgs.msg import MoveItErrorCodes, RobotTrajectory
from rclpy.action import GoalResponse
from rclpy.action.server import default_goal_callback, default_handle_accepted_callback
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from nodes.planning import controllers, move_action
from nodes.planning.controllers import RouteController, StopRequest
from nodes.planning.conversion.trajectories import duration
from nodes.planning.execution import Execution
from nodes.planning.move_action import MoveActions
from nodes.planning.move_group import MoveGroupNode
from nodes.planning.request_errors import RequestError
from nodes.planning.requests import Snapshot
from nodes.planning.routes import Route
from nodes.planning.world import first_world
from tests.nodes.planning.robots import READY, robot_arm

REASON = "the planning server is shutting down"
ARM = Route("arm_controller", "trajectory", tuple(joint for joint in READY if joint != "hand_right_joint"))
HAND = Route("hand_controller", "forward", ("hand_right_joint",))


class Log:
    """Logger that discards all messages."""

    def warning(self, text: str) -> None: ...


class FakeNode:
    """Node whose log, clock and publishers do not need a middleware."""

    def __init__(self) -> None:
        self.published: list[list[float]] = []
        self.executor = SimpleNamespace(create_task=lambda function, *arguments: function(*arguments))

    def get_logger(self) -> Log:
        return Log()

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=0))

    def resolve_topic_name(self, name: str) -> str:
        return f"/{name}"

    resolve_service_name = resolve_topic_name

    def create_publisher(self, *_: Any) -> Any:
        return SimpleNamespace(
            publish=lambda message: self.published.append(list(message.data)), get_subscription_count=lambda: 1
        )


class FakeServer:
    """Action server that receives its requests directly from the test."""

    def __init__(
        self, node: Any, kind: Any, name: str, execute: Callable[[Any], Awaitable[Any]], **options: Any
    ) -> None:
        self.name, self.execute = name, execute
        self._accepts = options.get("goal_callback", default_goal_callback)
        self._accepted = options.get("handle_accepted_callback", default_handle_accepted_callback)
        self.cancel = options["cancel_callback"]

    def send(self, goal: "FakeGoal") -> GoalResponse:
        """Send a goal, which the server executes only when the test awaits ``execute``."""
        response: GoalResponse = self._accepts(goal.request)
        if response is GoalResponse.ACCEPT:
            self._accepted(goal)
        return response


class FakeGoal:
    """Goal handle of the server."""

    def __init__(self) -> None:
        self.goal_id = SimpleNamespace(uuid=bytes(16))
        self.request = ExecuteTrajectory.Goal()
        self.is_cancel_requested = False
        self.status = ""

    def execute(self) -> None: ...

    def publish_feedback(self, feedback: Any) -> None: ...

    def succeed(self) -> None:
        self.status = "succeeded"

    def canceled(self) -> None:
        self.status = "canceled"

    def abort(self) -> None:
        self.status = "aborted"


class FakeExecution:
    """Execution whose motions end at once, unless they are stopped."""

    async def run(self, trajectory: Any, names: Any, stop: StopRequest) -> None:
        if stop.requested:
            raise RequestError(stop.code, stop.message)

    def stop_all(self, code: str, message: str) -> None: ...


class Actions:
    """The actions of a planning server, and the server of /execute_trajectory."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        servers: list[FakeServer] = []

        def make(*arguments: Any, **options: Any) -> FakeServer:
            servers.append(FakeServer(*arguments, **options))
            return servers[-1]

        monkeypatch.setattr(move_action, "ActionServer", make)
        planning: Any = SimpleNamespace(requests=SimpleNamespace(robot=None))
        self.actions = MoveActions(FakeNode(), planning, FakeExecution())  # type: ignore[arg-type]
        (self.server,) = (server for server in servers if server.name == "execute_trajectory")


def result_of(work: Awaitable[Any]) -> Any:
    """Return the result of a coroutine that never waits."""
    assert isinstance(work, Coroutine)
    with pytest.raises(StopIteration) as end:
        work.send(None)
    return end.value.value


@pytest.mark.parametrize("stops_all", [False, True])
def test_a_goal_that_is_stopped_before_its_task_starts_does_not_move(
    monkeypatch: pytest.MonkeyPatch, stops_all: bool
) -> None:
    served, goal = Actions(monkeypatch), FakeGoal()
    assert served.server.send(goal) is GoalResponse.ACCEPT
    if stops_all:
        served.actions.stop_all("PREEMPTED", "the motion was stopped")
    else:
        served.server.cancel(goal)
        goal.is_cancel_requested = True
    result = result_of(served.server.execute(goal))
    assert result.error_code.val == MoveItErrorCodes.PREEMPTED
    assert goal.status == ("aborted" if stops_all else "canceled")
    assert served.actions.is_idle


def test_goals_are_rejected_while_the_server_exits(monkeypatch: pytest.MonkeyPatch) -> None:
    served, running = Actions(monkeypatch), FakeGoal()
    served.server.send(running)
    sent = []

    class ClientSendsNext:
        """Wait for the end of the running motion, in which a client sends its next goal."""

        async def until(self, timeout_s: float) -> None:
            sent.append(served.server.send(FakeGoal()))
            result_of(served.server.execute(running))

    workers = SimpleNamespace(close=lambda: None)
    node: Any = SimpleNamespace(_actions=served.actions, _waiter=ClientSendsNext(), _workers=workers)
    result_of(MoveGroupNode.stop(node, REASON))
    assert sent == [GoalResponse.REJECT]
    assert served.actions.is_idle


def trajectory(*joints: str) -> JointTrajectory:
    """Return a trajectory that begins at the ready pose."""
    start = [READY[joint] for joint in joints]
    points = [
        JointTrajectoryPoint(positions=[at + share for at in start], time_from_start=duration(2.0 * share))
        for share in (0.0, 0.02)
    ]
    return JointTrajectory(joint_names=list(joints), points=points)


class RecordingController:
    """Controller that records what it follows."""

    def __init__(self) -> None:
        self.route = ARM
        self.followed: list[JointTrajectory] = []

    async def follow(self, trajectory: JointTrajectory, stop: StopRequest) -> str:
        self.followed.append(trajectory)
        return ""


@pytest.mark.parametrize("stops", [False, True])
def test_a_motion_that_is_stopped_during_its_first_check_is_not_sent(stops: bool) -> None:
    stop, controller = StopRequest(), RecordingController()

    async def snapshot() -> Snapshot:
        return Snapshot(first_world(robot_arm()), READY)

    async def compute(work: Callable[[], Any]) -> None:
        if stops:
            stop.request("PREEMPTED", REASON)

    store: Any = SimpleNamespace(listeners=[], snapshot=snapshot)
    workers: Any = SimpleNamespace(compute=compute)
    execution = Execution(FakeNode(), robot_arm(), store, workers)  # type: ignore[arg-type]
    execution.controllers = {ARM.name: controller}
    run = execution.run(RobotTrajectory(joint_trajectory=trajectory(*ARM.joints)), (), stop)
    if stops:
        with pytest.raises(RequestError, match=REASON):
            result_of(run)
    else:
        result_of(run)
    assert len(controller.followed) == (not stops)
    assert execution.is_idle


@pytest.mark.parametrize("route", [ARM, HAND])
def test_a_controller_sends_nothing_after_a_stop(monkeypatch: pytest.MonkeyPatch, route: Route) -> None:
    sent: list[Any] = []
    client = SimpleNamespace(server_is_ready=lambda: True, send_goal_async=sent.append)
    monkeypatch.setattr(controllers, "ActionClient", lambda *_, **__: client)
    node, stop = FakeNode(), StopRequest()
    stop.request("PREEMPTED", REASON)
    joints: Any = SimpleNamespace(state=lambda: READY)
    controller: RouteController = controllers.controllers(node, (route,), joints)[route.name]  # type: ignore[arg-type]
    assert result_of(controller.follow(trajectory(*route.joints), stop)) == ""
    assert not sent
    assert not node.published

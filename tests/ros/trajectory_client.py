"""A client of one trajectory controller, in a process separate from the stack."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance, JointTrajectoryControllerState, SpeedScalingFactor
from control_msgs.srv import QueryTrajectoryState
from controller_manager_msgs.srv import SwitchController
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from tests.ros.stack_process import JOINTS, PATIENCE_S, StackProcess

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ARM = "arm_controller"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/msg/GoalStatus
REACHED = "Goal successfully reached!"
ZERO = (0.0,) * 6
NONE: Mapping[str, float] = MappingProxyType({})


def duration(seconds: float) -> Duration:
    """Convert seconds to a duration, which may be negative."""
    nanoseconds = round(seconds * 1e9)
    return Duration(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def seconds(stamp: Time | Duration) -> float:
    return float(stamp.sec) + stamp.nanosec * 1e-9


def stamp_s(message: Any) -> float:
    """Return the stamp of a message, in seconds."""
    return seconds(message.header.stamp)


def point(
    position: float | Sequence[float],
    after_s: float,
    velocities: Sequence[float] = (),
    accelerations: Sequence[float] = (),
    effort: Sequence[float] = (),
) -> JointTrajectoryPoint:
    """Create a point. One number applies to all six joints."""
    positions = [position] * 6 if isinstance(position, float) else list(position)
    return JointTrajectoryPoint(
        positions=positions,
        velocities=list(velocities),
        accelerations=list(accelerations),
        effort=list(effort),
        time_from_start=duration(after_s),
    )


def trajectory(*points: JointTrajectoryPoint, names: Sequence[str] = JOINTS, stamp: Time | None = None) -> Any:
    message = JointTrajectory(joint_names=list(names), points=list(points))
    if stamp is not None:
        message.header.stamp = stamp
    return message


def goal_of(
    message: JointTrajectory,
    goal_time_s: float = 0.0,
    path: Mapping[str, float] = NONE,
    goal: Mapping[str, float] = NONE,
) -> Any:
    """Create a goal. ``path`` and ``goal`` map joints to their tolerances."""
    made = FollowJointTrajectory.Goal(trajectory=message, goal_time_tolerance=duration(goal_time_s))
    made.path_tolerance = [JointTolerance(name=name, position=value) for name, value in path.items()]
    made.goal_tolerance = [JointTolerance(name=name, position=value) for name, value in goal.items()]
    return made


@dataclass(slots=True)
class Sent:
    """A running goal. ``handle`` is None if the goal was rejected."""

    handle: Any
    result: Any = None
    feedback: list[Any] = field(default_factory=list)


class TrajectoryClient:
    """Client that sends goals and receives states. All waits end on events and not after fixed times."""

    def __init__(self, stack: StackProcess) -> None:
        self.stack = stack
        self.node = Node("trajectory_client")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.reasons: list[str] = []
        self.states: list[JointTrajectoryControllerState] = []
        self.node.create_subscription(
            String, f"{ARM}/rejection_reason", lambda message: self.reasons.append(message.data), LATCHED
        )
        self.node.create_subscription(
            JointTrajectoryControllerState, f"{ARM}/controller_state", self.states.append, 100
        )
        self._scaling = self.node.create_publisher(SpeedScalingFactor, f"{ARM}/speed_scaling_input", 10)
        self._topic = self.node.create_publisher(JointTrajectory, f"{ARM}/joint_trajectory", 10)
        self.action = ActionClient(self.node, FollowJointTrajectory, f"{ARM}/follow_joint_trajectory")
        assert self.action.wait_for_server(PATIENCE_S)
        self.until(lambda: bool(self.states))
        self.until(self.topic_is_heard)

    def topic_is_heard(self) -> bool:
        """Return whether the controller has discovered this publisher."""
        return bool(self._scaling.get_subscription_count() and self._topic.get_subscription_count())

    def until(self, ready: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not ready():
            assert time.monotonic() < deadline_s, "never came"
            self.executor.spin_once(timeout_sec=0.1)

    def wait(self, future: Any) -> Any:
        self.until(future.done)
        return future.result()

    def send(self, goal: Any) -> Sent:
        """Send a goal and wait for the response."""
        sent = Sent(None)
        handle = self.wait(self.action.send_goal_async(goal, lambda message: sent.feedback.append(message.feedback)))
        if handle.accepted:
            sent.handle, sent.result = handle, handle.get_result_async()
        return sent

    def send_two(self, first: Any, second: Any) -> tuple[Sent, Sent]:
        """Send two goals at the same moment."""
        futures = [self.action.send_goal_async(goal) for goal in (first, second)]
        handles = [self.wait(future) for future in futures]
        one, two = (Sent(handle, handle.get_result_async()) for handle in handles)
        return one, two

    def outcome(self, sent: Sent) -> tuple[int, int, str]:
        """Wait for the end of a goal and return status, error code and text."""
        assert sent.handle is not None, self.reasons
        answer = self.wait(sent.result)
        return answer.status, answer.result.error_code, answer.result.error_string

    def executed(self, goal: Any) -> list[JointTrajectoryControllerState]:
        """Return the states from the last one before the goal to the second one after its success."""
        before = len(self.states)
        ended = self.outcome(self.send(goal))
        assert ended == (SUCCEEDED, 0, REACHED), ended
        self.cycles(2)
        return self.states[before - 1 :]

    def cancel(self, sent: Sent) -> int:
        """Return the number of goals in the result of the cancel request."""
        return len(self.wait(sent.handle.cancel_goal_async()).goals_canceling)

    def refusal(self, goal: Any) -> str:
        """Send a goal that must be rejected, and return the reason that is published on the topic."""
        before = len(self.reasons)
        assert self.send(goal).handle is None
        self.until(lambda: len(self.reasons) > before)
        return self.reasons[-1]

    def cycles(self, count: int) -> list[JointTrajectoryControllerState]:
        """Return the states of at least the next ``count`` cycles. States from before the call may still arrive."""
        first = self.now()
        self.until(lambda: len(self.states) >= first + count)
        return self.states[first:]

    def now(self) -> int:
        """Return the index of the first state that was measured after this call."""
        now_s = seconds(self.stamp(0.0))
        self.until(lambda: stamp_s(self.states[-1]) > now_s)
        return next(i for i, state in enumerate(self.states) if stamp_s(state) > now_s)

    def publish(self, message: JointTrajectory) -> None:
        self._topic.publish(message)

    def scale(self, factor: float) -> None:
        self._scaling.publish(SpeedScalingFactor(factor=factor))

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(PATIENCE_S)
        answer = self.wait(client.call_async(request))
        self.node.destroy_client(client)
        return answer

    def query(self, stamp: Time) -> Any:
        return self.call(QueryTrajectoryState, f"{ARM}/query_state", QueryTrajectoryState.Request(time=stamp))

    def switch(self, on: bool) -> bool:
        """Switch the controller of the arm, and return whether the manager reports success."""
        names = {"activate_controllers" if on else "deactivate_controllers": ["arm_controller"]}
        request = SwitchController.Request(strictness=2, **names)
        return bool(self.call(SwitchController, "controller_manager/switch_controller", request).ok)

    def set(self, name: str, value: Any) -> tuple[bool, str]:
        """Set a parameter of the controller, and return whether this succeeded, and the reason."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self.call(SetParameters, f"{ARM}/set_parameters", request).results
        return result.successful, result.reason

    def get(self, *names: str) -> list[Any]:
        """Return parameters of the controller."""
        request = GetParameters.Request(names=list(names))
        return list(map(parameter_value_to_python, self.call(GetParameters, f"{ARM}/get_parameters", request).values))

    def stamp(self, later_s: float) -> Time:
        nanoseconds = self.node.get_clock().now().nanoseconds + round(later_s * 1e9)
        return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)

    def close(self) -> None:
        self.executor.shutdown()
        self.action.destroy()  # ``destroy_node`` leaves action clients behind.
        self.node.destroy_node()


def measured(client: TrajectoryClient) -> list[float]:
    """Return the positions of the arm from /joint_states, as MoveIt does."""
    received: list[JointState] = []
    listener = client.node.create_subscription(JointState, "joint_states", received.append, 10)
    client.until(lambda: bool(received))
    client.node.destroy_subscription(listener)
    position = dict(zip(received[-1].name, received[-1].position, strict=True))
    return [position[joint] for joint in JOINTS]

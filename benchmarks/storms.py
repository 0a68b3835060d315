"""Measure the timing of the control loop while clients misbehave: ``python -m benchmarks.storms [--seconds 60]``.

The stack runs on mock hardware in a separate process. During each flood ("storm"), the benchmark records the
/joint_states stamps and the number of missed cycles. The benchmark also compares the arm's positions before and after
the storm. The exit status is 1 if a cycle was missed or the arm has moved.
"""

import argparse
import random
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise

from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.srv import ListControllers
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rich.console import Console
from rich.table import Table

from benchmarks.processes.children import child, kill, next_line, start
from benchmarks.ros import HERE, PATIENCE_S, goal_to, stack
from benchmarks.storm_watch import StormWatch, participant
from nodes.ros_process import spin_until_done

GOALS_PER_S = 100
CLIENTS = 50
RESEND_S = 10.0
"""Timeout after which a request is repeated, as in ros2_control's command line, in seconds. The first response from a
service may be lost while client and server discover each other."""
MOVED_RAD = 1e-3


def goals(seconds: float) -> None:
    """Send a hundred goals per second. Each goal replaces the previous one. The last goal returns to the start."""
    with participant("bench_goals") as (node, executor):
        client = ActionClient(node, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
        assert client.wait_for_server(PATIENCE_S)
        due_s = time.monotonic()
        end_s = due_s + seconds
        while due_s < end_s:
            near = tuple(a + random.uniform(-0.1, 0.1) for a in HERE)
            client.send_goal_async(goal_to(near, 1.0))
            due_s += 1.0 / GOALS_PER_S
            while (left_s := due_s - time.monotonic()) > 0.0:
                executor.spin_once(timeout_sec=left_s)
        home(node, executor, client)


def home(node: Node, executor: SingleThreadedExecutor, client: ActionClient) -> None:
    """Move the arm to the position at which every storm starts."""
    answer = client.send_goal_async(goal_to(HERE, 2.5))
    spin_until_done(executor, answer, PATIENCE_S)
    result = answer.result().get_result_async()
    spin_until_done(executor, result, PATIENCE_S)
    assert result.result().result.error_code == 0, result.result().result.error_string


def killed_client(seconds: float) -> None:
    """Kill a client while its goal is running. The arm completes the motion and holds its position."""
    del seconds
    program = (
        "from benchmarks.storms import ActionClient, FollowJointTrajectory as F, goal_to\n"
        "from benchmarks.storm_watch import participant\n"
        "from benchmarks.ros import THERE\n"
        "with participant('victim') as (node, executor):\n"
        "    client = ActionClient(node, F, '/arm_controller/follow_joint_trajectory')\n"
        "    client.wait_for_server(30.0)\n"
        "    client.send_goal_async(goal_to(THERE, 2.5))\n"
        "    print('sent', flush=True)\n"
        "    while True: executor.spin_once(timeout_sec=1.0)\n"
    )
    with child("-c", program, says="sent"):
        time.sleep(0.5)  # The client is killed in the middle of the motion.
    time.sleep(3.0)
    with participant("bench_home") as (node, executor):
        client = ActionClient(node, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
        assert client.wait_for_server(PATIENCE_S)
        home(node, executor, client)


def killed_participants(seconds: float) -> None:
    """Kill processes that have many subscribers as soon as they receive a message."""
    program = (
        "from sensor_msgs.msg import JointState\n"
        "from benchmarks.storm_watch import participant\n"
        "with participant('listener') as (node, executor):\n"
        "    for i in range(20): node.create_subscription(JointState, '/joint_states', lambda m: None, 10)\n"
        "    executor.spin_once(timeout_sec=30.0)\n"
        "    print('heard', flush=True)\n"
        "    while True: executor.spin_once(timeout_sec=1.0)\n"
    )
    end_s = time.monotonic() + min(seconds, 15.0)
    while time.monotonic() < end_s:
        with child("-c", program, says="heard"):
            pass


def listing(seconds: float) -> None:
    """Run fifty processes that list the controllers repeatedly at the same time."""
    program = (
        "import sys\n"
        "from benchmarks.storm_watch import participant\n"
        "from benchmarks.storms import list_often\n"
        "with participant(f'lister_{sys.argv[1]}') as (node, executor):\n"
        "    list_often(node, executor, float(sys.argv[2]))\n"
    )
    lasts = str(min(seconds, 15.0))
    with ExitStack() as ending:
        clients = [start("-c", program, str(number), lasts) for number in range(CLIENTS)]
        for client in clients:
            ending.callback(kill, client)
        for client in clients:
            assert next_line(client) == "ready"  # the client has discovered the service
        for client in clients:
            assert client.stdin is not None
            client.stdin.write("go\n")
            client.stdin.flush()
        counts = [int(next_line(client)) for client in clients]
    assert len(counts) == CLIENTS and all(counts), "a client received no response"


def list_often(node: Node, executor: SingleThreadedExecutor, seconds: float) -> None:
    """List the controllers repeatedly in one of the fifty processes, and print how often they were listed.

    The process first waits for the service and then for a line of input.
    """
    client = node.create_client(ListControllers, "/controller_manager/list_controllers")
    assert client.wait_for_service(PATIENCE_S)
    print("ready", flush=True)
    sys.stdin.readline()
    count, end_s = 0, time.monotonic() + seconds
    last_s = end_s + PATIENCE_S
    while time.monotonic() < (last_s if not count else end_s):
        answer = client.call_async(ListControllers.Request())
        spin_until_done(executor, answer, RESEND_S)
        count += answer.done() and len(answer.result().controller) == 3
    print(count, flush=True)


def deaf_clients(seconds: float) -> None:
    """Send requests with a QoS that is incompatible with every response, so that the middleware waits for a timeout."""
    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    end_s = time.monotonic() + min(seconds, 15.0)
    with participant("bench_deaf") as (node, executor):
        client = node.create_client(ListControllers, "/controller_manager/list_controllers", qos_profile=qos)
        while time.monotonic() < end_s:
            client.call_async(ListControllers.Request())
            executor.spin_once(timeout_sec=0.25)


NONSENSE = (
    ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float("nan")),
    ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=-1e308),
    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="x" * 10_000),
    ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=-(2**62)),
    ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=["joint9"] * 100),
    ParameterValue(type=ParameterType.PARAMETER_NOT_SET),
)


def nonsense(seconds: float) -> None:
    """Set every parameter of every node to invalid values."""
    from rcl_interfaces.srv import ListParameters

    end_s = time.monotonic() + min(seconds, 15.0)
    nodes = ("controller_manager", "arm_controller", "hand_controller", "joint_state_broadcaster", "robot_arm")
    with participant("bench_nonsense") as (node, executor):

        def call(kind: type, name: str, request: object) -> object:
            client = node.create_client(kind, name)
            assert client.wait_for_service(PATIENCE_S), name
            answer = client.call_async(request)
            spin_until_done(executor, answer, PATIENCE_S)
            node.destroy_client(client)
            return answer.result()

        while time.monotonic() < end_s:
            for name in nodes:
                names = call(ListParameters, f"/{name}/list_parameters", ListParameters.Request()).result.names  # type: ignore[attr-defined]
                wrong = [Parameter(name=n, value=value) for n in (*names, "no.such.one") for value in NONSENSE]
                call(SetParameters, f"/{name}/set_parameters", SetParameters.Request(parameters=wrong))


STORMS: dict[str, Callable[[float], None]] = {
    "nothing": lambda seconds: time.sleep(min(seconds, 15.0)),
    "100 goals a second": goals,
    "a killed client": killed_client,
    "killed participants": killed_participants,
    "50 clients listing": listing,
    "deaf clients": deaf_clients,
    "nonsense parameters": nonsense,
}


def run(name: str, seconds: float, watch: StormWatch) -> tuple[list[float], int, float]:
    """Run one storm.

    Returns:
        The stamps in seconds, the number of missed cycles, and the arm's distance from its start at the end, in rad.
    """
    watch.wait_for_report()
    first, missed, before = len(watch.stamps_s), watch.missed, list(watch.position)
    STORMS[name](seconds)
    watch.wait_for_report()
    away = max(abs(a - b) for a, b in zip(before, watch.position, strict=True))
    return watch.stamps_s[first:], watch.missed - missed, away


def show(console: Console, found: dict[str, tuple[list[float], int, float]]) -> None:
    """Print one row per storm."""
    table = Table(
        "storm", "cycles", "missed", "period's deviation, us: p50 / p99 / largest", "distance of the arm, rad"
    )
    for name, (stamps_s, missed, away) in found.items():
        periods = [b - a for a, b in pairwise(stamps_s)]
        late = sorted(abs(period - 0.05) * 1e6 for period in periods)
        share = f"{late[len(late) // 2]:.0f} / {late[len(late) * 99 // 100]:.0f} / {late[-1]:.0f}"
        table.add_row(name, str(len(stamps_s)), str(missed), share, f"{away:.2g}")
    console.print(table)


def main() -> None:
    """Run all storms."""
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="duration of the goal storm; each other storm takes at most 15 s"
    )
    arguments = parser.parse_args()
    random.seed(1)
    found = {}
    with stack():
        watch = StormWatch()
        thread = threading.Thread(target=watch.run)
        thread.start()
        try:
            goals(0.0)  # home
            for name in STORMS:
                found[name] = run(name, arguments.seconds, watch)
        finally:
            watch.end()
            thread.join()
    show(Console(width=110), found)
    sys.exit(any(missed or away > MOVED_RAD for _, missed, away in found.values()))


if __name__ == "__main__":
    main()

"""Clients that misbehave, and what the loop's timing says to it: ``python -m bench.storms [--seconds 60]``.

The stack runs on the mock in a process of its own. While each storm blows, the stamps of /joint_states and the
loop's own account of missed cycles are watched; the arm's position before and after is compared. Exits 1 if a cycle
was missed or the arm stands elsewhere.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

import rclpy
from control_msgs.action import FollowJointTrajectory
from controller_manager_msgs.srv import ListControllers
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState

from bench.ros import HERE, PATIENCE_S, goal_to, stack
from nodes.leaving import leaving

GOALS_PER_S = 100
CLIENTS = 50
RESEND_S = 10.0
"""As upstream's command line: a service's first answer can get lost while the two discover each other."""
MOVED_RAD = 1e-3


@contextmanager
def participant(name: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """A client with a DDS participant of its own."""
    context = Context()
    rclpy.init(context=context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
    node = Node(name, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        with leaving():
            executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
            context.try_shutdown()


@dataclass(slots=True)
class Watch:
    """What is seen of the stack, from a thread of its own."""

    stamps_s: list[float] = field(default_factory=list)
    position: list[float] = field(default_factory=list)
    missed: int = 0
    reports: int = 0
    _stop: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Listen until ``end``."""
        with participant("bench_watch") as (node, executor):
            node.create_subscription(JointState, "/joint_states", self._on_state, 1000)
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
            while not self._stop.is_set():
                executor.spin_once(timeout_sec=0.1)

    def end(self) -> None:
        """No more."""
        self._stop.set()

    def wait_for_report(self) -> None:
        """Until the loop has reported anew, so that ``missed`` is up to date."""
        before, deadline_s = self.reports, time.monotonic() + PATIENCE_S
        while self.reports < before + 2:
            assert time.monotonic() < deadline_s, "the stack reports no more"
            time.sleep(0.05)

    def _on_state(self, message: JointState) -> None:
        self.stamps_s.append(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)
        self.position = list(message.position)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "servoloop: control loop":
                self.missed = int({v.key: v.value for v in status.values}["missed_cycles"])
                self.reports += 1


def goals(seconds: float) -> None:
    """A hundred goals a second, each over the one before; the last one, left alone, leads home."""
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
    """Bring the arm to where every storm begins."""
    answer = client.send_goal_async(goal_to(HERE, 2.5))
    executor.spin_until_future_complete(answer, timeout_sec=PATIENCE_S)
    result = answer.result().get_result_async()
    executor.spin_until_future_complete(result, timeout_sec=PATIENCE_S)
    assert result.result().result.error_code == 0, result.result().result.error_string


def killed_client(seconds: float) -> None:
    """Clients that are killed in the middle of their goal. The arm goes on to where it was sent, and holds there."""
    del seconds
    program = (
        "from bench.storms import ActionClient, FollowJointTrajectory as F, goal_to, participant\n"
        "from bench.ros import THERE\n"
        "with participant('victim') as (node, executor):\n"
        "    client = ActionClient(node, F, '/arm_controller/follow_joint_trajectory')\n"
        "    client.wait_for_server(30.0)\n"
        "    client.send_goal_async(goal_to(THERE, 2.5))\n"
        "    print('sent', flush=True)\n"
        "    while True: executor.spin_once(timeout_sec=1.0)\n"
    )
    victim = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert victim.stdout is not None
    victim.stdout.readline()
    time.sleep(0.5)
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    time.sleep(3.0)
    with participant("bench_home") as (node, executor):
        client = ActionClient(node, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
        assert client.wait_for_server(PATIENCE_S)
        home(node, executor, client)


def killed_participants(seconds: float) -> None:
    """Processes full of subscribers, killed as soon as they hear something."""
    program = (
        "from bench.storms import participant, JointState\n"
        "with participant('listener') as (node, executor):\n"
        "    for i in range(20): node.create_subscription(JointState, '/joint_states', lambda m: None, 10)\n"
        "    executor.spin_once(timeout_sec=30.0)\n"
        "    print('heard', flush=True)\n"
        "    while True: executor.spin_once(timeout_sec=1.0)\n"
    )
    end_s = time.monotonic() + min(seconds, 15.0)
    while time.monotonic() < end_s:
        victim = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
        assert victim.stdout is not None
        victim.stdout.readline()
        victim.send_signal(signal.SIGKILL)
        victim.wait()


def listing(seconds: float) -> None:
    """Fifty processes list the controllers at once, again and again."""
    program = (
        "import sys\n"
        "from bench.storms import list_often, participant\n"
        "with participant(f'lister_{sys.argv[1]}') as (node, executor):\n"
        "    list_often(node, executor, float(sys.argv[2]))\n"
    )
    commands = [[sys.executable, "-c", program, str(number), str(min(seconds, 15.0))] for number in range(CLIENTS)]
    clients = [subprocess.Popen(c, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for c in commands]
    for client in clients:
        assert client.stdout is not None
        client.stdout.readline()  # it sees the service
    for client in clients:
        assert client.stdin is not None
        client.stdin.write("go\n")
        client.stdin.flush()
    counts = [int(client.stdout.readline()) for client in clients if client.stdout is not None]
    for client in clients:
        client.wait()
    assert len(counts) == CLIENTS and all(counts), "a client got no answer"


def list_often(node: Node, executor: SingleThreadedExecutor, seconds: float) -> None:
    """In a process of its own: say that the service is seen, wait for the word, list, print how often."""
    client = node.create_client(ListControllers, "/controller_manager/list_controllers")
    assert client.wait_for_service(PATIENCE_S)
    print("ready", flush=True)
    sys.stdin.readline()
    count, end_s = 0, time.monotonic() + seconds
    while time.monotonic() < end_s or not count:
        answer = client.call_async(ListControllers.Request())
        executor.spin_until_future_complete(answer, timeout_sec=RESEND_S)
        count += answer.done() and len(answer.result().controller) == 3
    print(count, flush=True)


def deaf_clients(seconds: float) -> None:
    """Clients that listen with qualities of service that no answer has: the middleware waits for their ears in vain."""
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
    """Every parameter of every node set to what it cannot be."""
    from rcl_interfaces.srv import ListParameters

    end_s = time.monotonic() + min(seconds, 15.0)
    nodes = ("controller_manager", "arm_controller", "hand_controller", "joint_state_broadcaster", "robot_arm")
    with participant("bench_nonsense") as (node, executor):

        def call(kind: type, name: str, request: object) -> object:
            client = node.create_client(kind, name)
            assert client.wait_for_service(PATIENCE_S), name
            answer = client.call_async(request)
            executor.spin_until_future_complete(answer, timeout_sec=PATIENCE_S)
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


def run(name: str, seconds: float, watch: Watch) -> tuple[list[float], int, float]:
    """One storm: the stamps meanwhile (s), cycles missed, and how far from its place the arm stands after it (rad)."""
    watch.wait_for_report()
    first, missed, before = len(watch.stamps_s), watch.missed, list(watch.position)
    STORMS[name](seconds)
    watch.wait_for_report()
    away = max(abs(a - b) for a, b in zip(before, watch.position, strict=True))
    return watch.stamps_s[first:], watch.missed - missed, away


def show(console: Console, found: dict[str, tuple[list[float], int, float]]) -> None:
    """One line a storm."""
    table = Table("storm", "cycles", "missed", "period's deviation, us: p50 / p99 / largest", "arm away by, rad")
    for name, (stamps_s, missed, away) in found.items():
        periods = [b - a for a, b in pairwise(stamps_s)]
        late = sorted(abs(period - 0.05) * 1e6 for period in periods)
        share = f"{late[len(late) // 2]:.0f} / {late[len(late) * 99 // 100]:.0f} / {late[-1]:.0f}"
        table.add_row(name, str(len(stamps_s)), str(missed), share, f"{away:.2g}")
    console.print(table)


def main() -> None:
    """Blow them all."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0, help="how long goals rain; the others take 15 at most")
    arguments = parser.parse_args()
    random.seed(1)
    found = {}
    with stack():
        watch = Watch()
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

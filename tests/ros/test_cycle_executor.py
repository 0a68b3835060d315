"""The executor that reuses its wait set serves all kinds of entities and gives precedence to cycles."""

import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from control_msgs.action import ParallelGripperCommand
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from nodes.rclpy_patches.cycle_executor import CycleExecutor
from nodes.stack_nodes import StackNodes

PATIENCE_S = 30.0


@pytest.fixture
def executor(ros_domain: int) -> Iterator[CycleExecutor]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = CycleExecutor(threading.Lock())
    yield executor
    nodes = executor.get_nodes()
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def node(executor: CycleExecutor) -> Node:
    node = Node("served")
    executor.add_node(node)
    return node


def until(executor: CycleExecutor, ready: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not ready():
        assert time.monotonic() < deadline_s, "never came"
        executor.serve(0.1)


def settle(executor: CycleExecutor) -> None:
    """Serve events that are pending after the creation of entities."""
    for _ in range(20):
        executor.serve(0.01)


def call(executor: CycleExecutor, client: Any) -> Any:
    until(executor, client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    until(executor, answer.done)
    return answer.result().message


def answer(text: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    return lambda _request, _response: Trigger.Response(message=text)


def test_messages_calls_timers_and_guards_are_served(executor: CycleExecutor, node: Node) -> None:
    heard: list[Any] = []
    node.create_subscription(String, "/said", heard.append, 10)
    out = node.create_publisher(String, "/said", 10)
    node.create_service(Trigger, "/ask", answer("yes"))
    ticks: list[int] = []
    timer = node.create_timer(0.01, lambda: ticks.append(1))
    triggered: list[int] = []
    guard = node.create_guard_condition(lambda: triggered.append(1))
    until(executor, lambda: out.get_subscription_count())
    out.publish(String(data="hello"))
    until(executor, lambda: heard)
    assert heard == [String(data="hello")]
    assert call(executor, node.create_client(Trigger, "/ask")) == "yes"
    until(executor, lambda: len(ticks) > 3)
    timer.cancel()
    settle(executor)
    before = len(ticks)
    guard.trigger()
    until(executor, lambda: triggered)
    settle(executor)
    assert (len(triggered), len(ticks)) == (1, before)


def test_action_runs_while_other_entities_are_served(executor: CycleExecutor, node: Node) -> None:
    decided = Future()

    async def execute(goal: Any) -> ParallelGripperCommand.Result:
        await decided
        goal.succeed()
        return ParallelGripperCommand.Result(reached_goal=True)

    server = ActionServer(node, ParallelGripperCommand, "/grip", execute)
    node.create_service(Trigger, "/ask", answer("still here"))
    client = ActionClient(node, ParallelGripperCommand, "/grip")
    until(executor, client.server_is_ready)
    sent = client.send_goal_async(ParallelGripperCommand.Goal())
    until(executor, sent.done)
    result = sent.result().get_result_async()
    assert call(executor, node.create_client(Trigger, "/ask")) == "still here"
    assert not result.done()
    decided.set_result(None)
    until(executor, result.done)
    assert result.result().result.reached_goal
    client.destroy()
    server.destroy()


def test_waiting_callback_blocks_only_its_group(executor: CycleExecutor, node: Node) -> None:
    held = Future()

    async def slow(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        await held
        response.message = "slow"
        return response

    group = MutuallyExclusiveCallbackGroup()
    node.create_service(Trigger, "/slow", slow, callback_group=group)
    node.create_service(Trigger, "/its_neighbour", answer("neighbour"), callback_group=group)
    node.create_service(Trigger, "/other", answer("other"), callback_group=MutuallyExclusiveCallbackGroup())
    clients = [node.create_client(Trigger, name) for name in ("/slow", "/its_neighbour", "/other")]
    until(executor, lambda: all(client.service_is_ready() for client in clients))
    answers = [clients[0].call_async(Trigger.Request())]
    settle(executor)
    answers += [client.call_async(Trigger.Request()) for client in clients[1:]]
    until(executor, answers[2].done)
    settle(executor)
    assert [future.done() for future in answers] == [False, False, True]
    held.set_result(None)
    until(executor, lambda: all(future.done() for future in answers))
    assert [future.result().message for future in answers] == ["slow", "neighbour", "other"]


def test_added_entities_are_served_and_removed_ones_are_not(executor: CycleExecutor, node: Node) -> None:
    client = node.create_client(Trigger, "/ask")
    settle(executor)
    for number in range(3):
        service = node.create_service(Trigger, "/ask", answer(str(number)))
        assert call(executor, client) == str(number)
        node.destroy_service(service)
        until(executor, lambda: not client.service_is_ready())
    other = Node("other")
    other.create_service(Trigger, "/ask", answer("other"))
    executor.add_node(other)
    assert call(executor, client) == "other"
    executor.remove_node(other)
    other.destroy_node()
    until(executor, lambda: not client.service_is_ready())


def test_service_can_destroy_itself(executor: CycleExecutor, node: Node) -> None:
    def leave(_request: Trigger.Request, _response: Trigger.Response) -> Trigger.Response:
        node.destroy_service(second)
        return Trigger.Response(message="gone")

    node.create_service(Trigger, "/leave", leave)
    second = node.create_service(Trigger, "/second", answer("here"))
    clients = [node.create_client(Trigger, name) for name in ("/leave", "/second")]
    until(executor, lambda: all(client.service_is_ready() for client in clients))
    futures = [client.call_async(Trigger.Request()) for client in clients]
    until(executor, futures[0].done)
    until(executor, lambda: not clients[1].service_is_ready())


def test_error_in_a_callback_is_raised_and_others_are_served_later(executor: CycleExecutor, node: Node) -> None:
    def fail(_message: String) -> None:
        raise ValueError("an oddity")

    heard: list[Any] = []
    node.create_subscription(String, "/said", fail, 10)
    node.create_subscription(String, "/said", heard.append, 10)
    out = node.create_publisher(String, "/said", 10)
    until(executor, lambda: out.get_subscription_count() == 2)
    out.publish(String())
    with pytest.raises(ValueError, match="an oddity"):
        until(executor, lambda: False)
    until(executor, lambda: heard)


def test_guard_triggered_with_a_wake_up_is_served(executor: CycleExecutor, node: Node) -> None:
    triggered: list[int] = []
    guard = node.create_guard_condition(lambda: triggered.append(1))
    settle(executor)
    guard.trigger()
    executor.post()
    executor.serve(PATIENCE_S)
    settle(executor)
    assert triggered == [1]


def test_callbacks_wait_for_their_turn(executor: CycleExecutor, node: Node) -> None:
    triggered: list[int] = []
    guard = node.create_guard_condition(lambda: triggered.append(1))
    settle(executor)
    guard.trigger()
    with executor._turn:
        thread = threading.Thread(target=lambda: executor.serve(PATIENCE_S))
        thread.start()
        time.sleep(0.1)
        assert not triggered
    thread.join()
    settle(executor)
    assert triggered == [1]


def test_executor_can_be_woken_from_another_thread(executor: CycleExecutor, node: Node) -> None:
    settle(executor)
    thread = threading.Timer(0.05, executor.post)
    begin_s = time.monotonic()
    thread.start()
    executor.serve(PATIENCE_S)
    assert time.monotonic() - begin_s < PATIENCE_S / 2
    thread.join()


def test_wait_set_is_reused_between_changes(
    executor: CycleExecutor, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    node.create_service(Trigger, "/ask", answer("yes"))
    client = node.create_client(Trigger, "/ask")
    call(executor, client)
    settle(executor)
    gathered: list[int] = []
    gather = executor._gather
    monkeypatch.setattr(executor, "_gather", lambda: (gathered.append(1), gather()))
    for _ in range(5):
        executor.post()
        executor.serve(PATIENCE_S)
        call(executor, client)
    assert not gathered
    node.create_subscription(String, "/said", print, 10)
    settle(executor)
    assert gathered


def test_shutdown_of_ros_raises(executor: CycleExecutor, node: Node) -> None:
    settle(executor)
    rclpy.shutdown()
    with pytest.raises(ExternalShutdownException):
        executor.serve(PATIENCE_S)


def test_failing_callback_does_not_delay_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer is complete at the same time as the callback fails, and does not wake the executor again."""
    ros_nodes = StackNodes.__new__(StackNodes)
    answered: list[int] = []

    def serve(timeout_s: float) -> None:
        ros_nodes._woken = True
        raise RuntimeError("a client's oddity")

    monkeypatch.setattr(ros_nodes, "_executor", SimpleNamespace(serve=serve), raising=False)
    monkeypatch.setattr(ros_nodes, "_turn", threading.Lock(), raising=False)
    monkeypatch.setattr(ros_nodes, "_send_delayed", lambda: None, raising=False)
    monkeypatch.setattr(ros_nodes, "_synchronize", lambda: answered.append(1))
    monkeypatch.setattr(rclpy, "ok", lambda: True)
    ros_nodes._serve(lambda: bool(answered))
    assert answered == [1]

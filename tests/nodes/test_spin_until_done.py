"""After waiting for a future, the events that were served in the meantime have left no callbacks on it."""

import warnings
from collections.abc import Callable, Iterator
from time import monotonic

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from drivers.driver_errors import DriverError
from nodes.clients.timing_client import Promptness, TimedController, TimingClient
from nodes.ros_process import STOP_LIMIT_S, spin_until_done, spin_until_stopped


class Counting(Future):
    """Future that counts its callbacks."""

    hung = 0

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        self.hung += 1
        super().add_done_callback(callback)


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    rclpy.init()
    node = Node("waiting")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.ros
def test_served_events_leave_no_callback_on_the_future(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    answer, events = Counting(executor=executor), 0

    def event() -> None:
        nonlocal events
        events += 1
        if events == 50:
            answer.set_result("here")

    node.create_timer(0.001, event)
    assert spin_until_done(executor, answer, 60.0)
    assert (answer.result(), events, answer.hung) == ("here", 50, 0)
    executor.shutdown()


@pytest.mark.ros
def test_waiting_task_does_not_delay_events(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    answer, bell = Future(executor=executor), Future(executor=executor)

    async def wait() -> None:
        await bell
        answer.set_result(None)

    executor.create_task(wait)
    node.create_timer(0.01, lambda: bell.done() or bell.set_result(None))
    assert spin_until_done(executor, answer, 10.0)
    executor.shutdown()


@pytest.mark.ros
def test_wait_ends_at_the_timeout(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    assert not spin_until_done(executor, Future(), 0.05)
    executor.shutdown()


@pytest.mark.ros
def test_failing_callbacks_do_not_prevent_the_orderly_end(node: Node) -> None:
    executor, stopped, steps = SingleThreadedExecutor(), Future(), list[str]()
    executor.add_node(node)
    bell = Future(executor=executor)

    def fail() -> None:
        if steps and not bell.done():
            bell.set_result(None)
        raise ValueError("a defect")

    async def stop() -> None:
        steps.append("cancel")
        await bell
        steps.append("result")
        stopped.set_result(None)

    node.create_timer(0.01, fail)
    with pytest.raises(ValueError, match="a defect"):
        spin_until_stopped(executor, stopped, stop)
    assert steps == ["cancel", "result"]
    executor.shutdown()


@pytest.mark.ros
def test_an_executor_whose_context_has_ended_is_not_spun_any_longer(node: Node) -> None:
    """Every turn would fail at once, so the process would use a whole processor until the time limit."""
    executor, begin_s = SingleThreadedExecutor(), monotonic()
    executor.add_node(node)

    async def stop() -> None:
        pytest.fail("the arm cannot be stopped over ROS")

    node.create_timer(0.01, rclpy.shutdown)
    with warnings.catch_warnings(), pytest.raises(RuntimeError, match="the given context is not valid"):
        warnings.simplefilter("error")
        spin_until_stopped(executor, Future(), stop)
    assert monotonic() - begin_s < 0.2 * STOP_LIMIT_S


@pytest.mark.ros
def test_an_executor_that_fails_in_every_turn_uses_little_processor_time(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nodes.ros_process.STOP_LIMIT_S", 1.0)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    turns = 0

    def fail(timeout_sec: float | None = None) -> None:
        nonlocal turns
        turns += 1
        raise ValueError("a defect")

    async def stop() -> None:
        pass

    monkeypatch.setattr(executor, "spin_once", fail)
    monkeypatch.setattr(executor, "create_task", lambda task: Future())
    with pytest.raises(ValueError, match="a defect"):
        spin_until_stopped(executor, Future(), stop)
    assert turns <= 102
    executor.shutdown()


@pytest.mark.ros
def test_measurement_that_is_stopped_does_not_wait_for_its_server(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with pytest.raises(DriverError, match="the measurement was stopped"):
        TimingClient(node, executor, TimedController(["joint1"]), Promptness(), stop=lambda: True)
    executor.shutdown()

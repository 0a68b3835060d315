"""All ROS nodes of one stack on one executor. The loop posts its cycles here and never waits."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic

import rclpy
from rclpy.executors import ExternalShutdownException

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.manager.client import ManagerClient
from hal.types import JointState
from nodes.controllers.controller_nodes import ControllerNodes
from nodes.manager.controller_manager_node import ManagerNode
from nodes.manager.hardware_nodes import HardwareNodes
from nodes.manager.hardware_services import HardwareServices
from nodes.manager.pending_requests import PendingRequests
from nodes.rclpy_patches import cycle_executor, gil_release
from nodes.rclpy_patches.guard import usable_patches
from nodes.rclpy_patches.plain_executor import PlainExecutor
from nodes.robot_state_publisher import RobotStatePublisher
from nodes.ros_process import exit_watchdog, init_rclpy, rcl_errors
from nodes.ros_time import RosTime
from nodes.simulation_node import SimulationNode
from nodes.stack import Stack

FINISH_S = 0.2

LOG = logging.getLogger("servoloop.nodes")


class Surface:
    """The ROS 2 side. ``post`` is for the loop's thread, everything else for the ROS thread."""

    def __init__(self, stack: Stack) -> None:
        patches = usable_patches()
        self._send_what_waits: Callable[[], None] = lambda: None
        if gil_release.PATCH in patches:
            gil_release.release_gil_in_middleware()
            self._send_what_waits = gil_release.send_what_waits
        LOG.info("%s", init_rclpy())
        self._stack = stack
        self._cycles: deque[JointState] = deque(maxlen=100)
        self._posted = self._published = 0
        """Cycles, counted by one thread each."""
        self._woken = False
        self._caught_up = threading.Condition()
        self._pending = PendingRequests()
        self._ros_time = ros_time = RosTime(stack.loop.clock, stack.simulation is not None)
        manager_client = ManagerClient(stack.loop, stack.factory)
        with rcl_errors():  # of the first node: the others come up where it does
            self._manager = ManagerNode(stack, manager_client, self._pending, ros_time)
        kept = cycle_executor.PATCH in patches
        self._executor = cycle_executor.CycleExecutor() if kept else PlainExecutor(self._manager.node)
        HardwareServices(self._manager.node, stack, self._pending)
        self._hardware = HardwareNodes(stack, ros_time)
        self._robot_state_publisher = RobotStatePublisher(stack, ros_time) if stack.publish_transforms else None
        robot_state_publishers = [self._robot_state_publisher.node] if self._robot_state_publisher is not None else []
        self._simulation = SimulationNode(stack.simulation, ros_time, self._pending) if stack.simulation else None
        simulations = [self._simulation.node] if self._simulation is not None else []
        self._own = (self._manager.node, *self._hardware.nodes, *robot_state_publishers, *simulations)
        self._controllers = ControllerNodes(stack.loop.manager, manager_client, self._executor, ros_time)
        for node in self._own:
            self._executor.add_node(node)
        self._synchronize()

    def post(self, state: JointState) -> None:
        """Hand over a cycle that is done, and wake the ROS thread. Never waits."""
        self._cycles.append(state)
        self._posted += 1
        self._executor.post()

    def wake(self) -> None:
        """Without a cycle: let the ROS thread look what has been done for clients. Never waits."""
        self._woken = True
        self._executor.post()

    def wait_until_published(self, longest_s: float) -> bool:
        """True once all posted cycles are published: the loop of a simulation does not run away from its clients."""
        with self._caught_up:
            return self._caught_up.wait_for(lambda: self._published >= self._posted, longest_s)

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve until ``stop``. An error in a callback is logged and does not end the service."""
        while not stop() and rclpy.ok():
            try:
                with _errors_logged():
                    # Where the next cycle has come already, clients are served nevertheless.
                    self._executor.serve(0.1, behind=bool(self._cycles))
                with _errors_logged():
                    self._publish_cycles()
                with _errors_logged():
                    self._send_what_waits()
            except ExternalShutdownException:
                return

    def finish(self) -> None:
        """The loop has ended: give the clients whose goals ended with it their results, and the others their answer."""
        self._controllers.publish(self._manager.node.get_clock().now().to_msg())
        self._pending.resume_done()
        deadline_s = monotonic() + FINISH_S
        self.spin(lambda: monotonic() > deadline_s)

    def close(self) -> None:
        """Take all nodes off the graph."""
        with exit_watchdog():
            self._executor.shutdown(timeout_sec=1.0)
            self._controllers.close()
            for node in self._own:
                node.destroy_node()
            rclpy.try_shutdown()

    def _publish_cycles(self) -> None:
        if not self._cycles:
            if self._woken:
                self._woken = False
                self._synchronize()
            return
        states = [self._cycles.popleft() for _ in range(len(self._cycles))]
        try:
            self._publish(states)
        finally:
            with self._caught_up:
                self._published += len(states)
                self._caught_up.notify_all()

    def _publish(self, states: Sequence[JointState]) -> None:
        offset_s = self._ros_time.offset_s()
        cycles = [(state, self._ros_time.stamp(state.stamp_s + offset_s)) for state in states]
        state, stamp = cycles[-1]  # where the ROS side lags behind, the newest is what counts, but for joint states
        if self._simulation is not None:
            self._simulation.advance(stamp)
        self._controllers.publish(stamp, cycles)
        self._hardware.update(state)
        for broadcaster in self._broadcasters:
            if self._robot_state_publisher is not None and broadcaster.state is not None:
                self._robot_state_publisher.publish(broadcaster.sample(state), stamp)
        self._synchronize()

    def _synchronize(self) -> None:
        """Give a loaded controller its node before the client that asked for it gets the answer."""
        complete = True
        try:
            complete = self._controllers.synchronize()
            self._manager.publish()
            self._broadcasters = [
                c
                for c in self._controllers.controllers
                if isinstance(c, JointStateBroadcaster) and not c.parameters.use_local_topics
            ]
        finally:  # whatever has failed, clients wait for their answers
            if complete:
                self._pending.resume_done()


@contextmanager
def _errors_logged() -> Iterator[None]:
    """A client's oddity must not take the surface from the others."""
    try:
        yield
    except ExternalShutdownException:
        raise
    except Exception:
        LOG.exception("in a ROS callback")

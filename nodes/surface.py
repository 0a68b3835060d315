"""All ROS nodes of one stack on one executor. The loop posts its cycles here and never waits."""

import logging
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from controller.desk import Desk
from controller.joint_state_broadcaster import JointStateBroadcaster
from drivers.clock import wall_offset_s
from hal.types import JointState
from nodes.controller_nodes import ControllerNodes
from nodes.conversions import time_message
from nodes.executor import CycleExecutor
from nodes.hardware_node import HardwareNodes
from nodes.hardware_services import HardwareServices
from nodes.leaving import leaving
from nodes.manager_node import ManagerNode
from nodes.robot_state_publisher import RobotStatePublisher
from nodes.stack import Stack
from nodes.unlocked import leave_the_lock_to_others
from nodes.waiting import Waiting

GOODBYE_S = 0.2

LOG = logging.getLogger("servoloop.nodes")


class Surface:
    """The ROS 2 side. ``post`` is for the loop's thread, everything else for the ROS thread."""

    def __init__(self, stack: Stack) -> None:
        leave_the_lock_to_others()
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # the wiring has its own
        self._stack = stack
        self._cycles: deque[JointState] = deque(maxlen=100)
        self._waiting = Waiting()
        desk = Desk(stack.loop, stack.factory)
        self._executor = CycleExecutor()
        self._manager = ManagerNode(stack, desk, self._waiting)
        HardwareServices(self._manager.node, stack, self._waiting)
        self._hardware = HardwareNodes(stack)
        self._links = RobotStatePublisher(stack) if stack.links else None
        links = [self._links.node] if self._links is not None else []
        self._own = (self._manager.node, *self._hardware.nodes, *links)
        self._controllers = ControllerNodes(stack.loop.manager, desk, self._executor)
        for node in self._own:
            self._executor.add_node(node)
        self._follow()

    def post(self, state: JointState) -> None:
        """One cycle is done: wake the ROS thread. Never waits."""
        self._cycles.append(state)
        self._executor.post()

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve until ``stop``. An error in a callback is logged and does not end the service."""
        while not stop() and rclpy.ok():
            try:
                with _survived():
                    # Where the next cycle has come already, clients are served nevertheless.
                    self._executor.serve(0.1, behind=bool(self._cycles))
                with _survived():
                    self._drain()
            except ExternalShutdownException:
                return

    def say_goodbye(self) -> None:
        """The loop has ended: give the clients whose goals ended with it their results, and the others their answer."""
        self._controllers.publish(self._manager.node.get_clock().now().to_msg())
        self._waiting.settle()
        deadline = self._stack.loop.clock.now() + GOODBYE_S
        self.spin(lambda: self._stack.loop.clock.now() > deadline)

    def close(self) -> None:
        """Take all nodes off the graph."""
        with leaving():
            self._executor.shutdown(timeout_sec=1.0)
            self._controllers.close()
            for node in self._own:
                node.destroy_node()
            rclpy.try_shutdown()

    def _drain(self) -> None:
        if not self._cycles:
            return
        offset_s = wall_offset_s(self._stack.loop.clock, time)
        states = [self._cycles.popleft() for _ in range(len(self._cycles))]
        cycles = [(state, time_message(state.stamp_s + offset_s)) for state in states]
        state, stamp = cycles[-1]  # where the ROS side lags behind, the newest is what counts, but for joint states
        self._hardware.see(state)
        self._controllers.publish(stamp, cycles)
        for broadcaster in self._broadcasters:
            if self._links is not None and broadcaster.state is not None:
                self._links.publish(broadcaster.sample(state), stamp)
        self._follow()

    def _follow(self) -> None:
        """Who is loaded has its node before the client that wanted it gets the answer."""
        there = self._controllers.follow()
        self._manager.publish()
        self._broadcasters = [
            c
            for c in self._controllers.controllers
            if isinstance(c, JointStateBroadcaster) and not c.parameters.use_local_topics
        ]
        if there:
            self._waiting.settle()


@contextmanager
def _survived() -> Iterator[None]:
    """A client's oddity must not take the surface from the others."""
    try:
        yield
    except ExternalShutdownException:
        raise
    except Exception:
        LOG.exception("in a ROS callback")

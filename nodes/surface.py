"""All ROS nodes of one stack on one executor. The loop posts its cycles here and never waits."""

import logging
from collections import deque
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.signals import SignalHandlerOptions

from controller.joint_state_broadcaster import JointStateBroadcaster
from hal.types import JointState
from nodes.conversions import time_message
from nodes.faces import face_of
from nodes.hardware_node import HardwareNode
from nodes.manager_node import ManagerNode
from nodes.robot_state_publisher import RobotStatePublisher
from nodes.stack import Stack

GOODBYE_S = 0.2

LOG = logging.getLogger("servoloop.nodes")


class Surface:
    """The ROS 2 side. ``post`` is for the loop's thread, everything else for the ROS thread."""

    def __init__(self, stack: Stack) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # the wiring has its own
        self._stack = stack
        self._cycles: deque[JointState] = deque(maxlen=100)
        self._manager = ManagerNode(stack)
        self._hardware = HardwareNode(stack)
        self._links = RobotStatePublisher(stack)
        controllers = stack.loop.manager.controllers.values()
        self._faces = [face_of(controller) for controller in controllers]
        self._broadcasters = [c for c in controllers if isinstance(c, JointStateBroadcaster)]
        self._executor = SingleThreadedExecutor()
        for node in (self._manager.node, self._hardware.node, self._links.node, *(face.node for face in self._faces)):
            self._executor.add_node(node)
        self._guard: GuardCondition = self._manager.node.create_guard_condition(self._drain)

    def post(self, state: JointState) -> None:
        """One cycle is done: wake the ROS thread. Never waits."""
        self._cycles.append(state)
        self._guard.trigger()

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve until ``stop``. An error in a callback is logged and does not end the service."""
        while not stop() and rclpy.ok():
            try:
                self._executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                return
            except Exception:  # a client's oddity must not take the surface from the others
                LOG.exception("in a ROS callback")

    def say_goodbye(self) -> None:
        """The loop has ended: give the clients whose goals ended with it their results."""
        stamp = self._manager.node.get_clock().now().to_msg()
        for face in self._faces:
            face.publish(stamp)
        deadline = self._stack.loop.clock.now() + GOODBYE_S
        self.spin(lambda: self._stack.loop.clock.now() > deadline)

    def close(self) -> None:
        """Take all nodes off the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        for node in self._executor.get_nodes():
            node.destroy_node()
        rclpy.try_shutdown()

    def _drain(self) -> None:
        if not self._cycles:
            return
        state = self._cycles[-1]  # where the ROS side lags behind, the newest is what counts
        self._cycles.clear()
        age_s = self._stack.loop.clock.now() - state.stamp_s
        now_s = self._manager.node.get_clock().now().nanoseconds * 1e-9
        stamp = time_message(now_s - age_s)
        self._hardware.see(state)
        for face in self._faces:
            face.publish(stamp)
        for broadcaster in self._broadcasters:
            if broadcaster.latest is not None:
                self._links.publish(broadcaster.latest, stamp)

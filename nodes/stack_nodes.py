"""Run all ROS nodes of a stack on one executor, and publish the cycles of the control loop in a second thread.

The executor wakes only when a client sends something or is waiting for a response. The executor's callbacks and the
cycle publisher take turns, so that both can use the nodes.
"""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic

import rclpy

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.manager.client import ManagerClient
from hal.types import JointState
from nodes.controllers.controller_nodes import ControllerNodes
from nodes.cycle_publisher import CyclePublisher
from nodes.manager.controller_manager_node import ManagerNode
from nodes.manager.hardware_nodes import HardwareNodes
from nodes.manager.hardware_services import HardwareServices
from nodes.manager.pending_requests import PendingRequests
from nodes.robot_state_publisher import RobotStatePublisher
from nodes.ros_process import exit_watchdog, rcl_errors
from nodes.ros_time import RosTime
from nodes.simulation_node import SimulationNode
from nodes.spinning import FINISH_S, WAKE_S, errors_logged, executor_of, serve, start_rclpy
from nodes.stack import Stack


class StackNodes:
    """ROS 2 interface of one stack.

    The loop thread calls ``post`` and ``wait_until_published``. A separate thread publishes the cycles. All other
    methods must be called from the ROS thread.
    """

    def __init__(self, stack: Stack) -> None:
        self._send_delayed = start_rclpy(stack.namespace)
        self._stack = stack
        self._turn = threading.Lock()
        """Lock that is held by the thread that is using the nodes: the executor during callbacks, or the cycle
        publisher."""
        self._publisher = CyclePublisher(self._publish_cycles)
        self._woken = False
        self._pending = PendingRequests()
        self._ros_time = ros_time = RosTime(stack.loop.clock, stack.simulation is not None)
        manager_client = ManagerClient(stack.loop, stack.factory)
        # All names have been checked, so if this node can be created, the others can be created too.
        with rcl_errors():
            self._manager = ManagerNode(stack, manager_client, self._pending, ros_time)
        self._executor = executor_of(self._manager.node, self._turn)
        HardwareServices(self._manager.node, stack, self._pending)
        self._hardware = HardwareNodes(stack, ros_time, self._manager.others)
        self._robot_state_publisher = RobotStatePublisher(stack, ros_time) if stack.publish_transforms else None
        robot_state_publishers = [self._robot_state_publisher.node] if self._robot_state_publisher is not None else []
        self._simulation = SimulationNode(stack.simulation, ros_time, self._pending) if stack.simulation else None
        simulations = [self._simulation.node] if self._simulation is not None else []
        self._own_nodes = (self._manager.node, *self._hardware.nodes, *robot_state_publishers, *simulations)
        self._controllers = ControllerNodes(stack.loop.manager, manager_client, self._executor, ros_time)
        for node in self._own_nodes:
            self._executor.add_node(node)
        self._synchronize()
        self._publisher.start()

    def post(self, state: JointState) -> None:
        """Pass a completed cycle to the publisher without blocking."""
        self._publisher.post(state)

    def wake(self) -> None:
        """Wake the ROS thread to respond to clients whose requests are complete. This method does not block."""
        self._woken = True
        self._executor.post()

    def wait_until_published(self, longest_s: float) -> bool:
        """Wait until all posted cycles are published, so that a simulated loop cannot outrun its clients.

        Returns:
            Whether the cycles were published within ``longest_s`` seconds.
        """
        return self._publisher.wait_until_published(longest_s)

    def spin(self, stop: Callable[[], bool]) -> None:
        """Serve clients until ``stop`` returns True. Errors in a callback are logged and do not end this loop.

        Raises:
            RosError: This stack has just started, but another controller manager with the same name is running.
        """
        others = self._manager.others
        self._serve(lambda: stop() or others.must_end)
        others.require_none()

    def finish(self) -> None:
        """Send the remaining results and responses to clients after the control loop has stopped."""
        self._publisher.stop()
        with self._turn:
            self._controllers.publish(self._manager.node.get_clock().now().to_msg())
            self._pending.resume_done()
        deadline_s = monotonic() + FINISH_S
        self._serve(lambda: monotonic() > deadline_s)

    def close(self) -> None:
        """Remove all nodes from the graph."""
        with exit_watchdog():
            self._publisher.stop()
            self._executor.shutdown(timeout_sec=1.0)
            self._controllers.close()
            for node in self._own_nodes:
                node.destroy_node()
            rclpy.try_shutdown()

    def _serve(self, stop: Callable[[], bool]) -> None:
        serve(stop, (partial(self._executor.serve, WAKE_S), self._respond, self._send_delayed))

    def _publish_cycles(self, states: Sequence[JointState]) -> None:
        """Publish cycles, and wake the executor if clients are waiting for a response or nodes must be created."""
        with errors_logged(), self._turn:
            self._publish(states)
        with errors_logged(), self._turn:
            if self._pending.any_done or not self._controllers.current:
                self.wake()
            else:
                self._manager.publish()

    def _publish(self, states: Sequence[JointState]) -> None:
        offset_s = self._ros_time.offset_s()
        cycles = [(state, self._ros_time.stamp(state.stamp_s + offset_s)) for state in states]
        state, stamp = cycles[-1]  # If the ROS thread lags behind, only joint states are published for every cycle.
        if self._simulation is not None:
            self._simulation.advance(stamp)
        self._controllers.publish(stamp, cycles)
        self._hardware.update(state)
        self._manager.publish_cycle(state, stamp)
        measured = [broadcaster.sample(state) for broadcaster in self._broadcasters if broadcaster.state is not None]
        if self._robot_state_publisher is not None and measured:
            self._robot_state_publisher.publish(measured, stamp)

    def _respond(self) -> None:
        """Respond to clients whose requests are complete."""
        with self._turn:
            if self._woken:
                self._woken = False
                self._synchronize()

    def _synchronize(self) -> None:
        """Create the node of a loaded controller before the client that loaded it receives the response."""
        complete = True
        try:
            complete = self._controllers.synchronize()
            self._manager.publish()
            self._broadcasters = [
                c
                for c in self._controllers.controllers
                if isinstance(c, JointStateBroadcaster) and not c.parameters.use_local_topics
            ]
        finally:  # Clients are waiting for their responses even if one of the steps above has failed.
            if complete:
                self._pending.resume_done()

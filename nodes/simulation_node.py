"""Publish ``/clock``, and provide the services of mujoco_ros2_control that pause and step simulated time."""

from typing import Any, Final

from builtin_interfaces.msg import Time
from mujoco_ros2_control_msgs.srv import SetPause, StepSimulation
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rosgraph_msgs.msg import Clock as ClockMessage

from nodes.manager.pending_requests import PendingRequests
from nodes.parameter_node import ParameterNode
from nodes.publishing import EVERY_CALL
from nodes.ros_time import RosTime
from nodes.stack import Simulation

NAME: Final = "ros2_control_node"
"""Name of the mujoco_ros2_control node."""
REPEAT_S: Final = 0.1
"""Wall-clock period at which a paused simulation publishes its time for new subscribers, in seconds."""


class SimulationNode:
    """Node for simulated time. All methods must be called from the ROS thread."""

    def __init__(self, simulation: Simulation, ros_time: RosTime, pending: PendingRequests) -> None:
        self.node = ParameterNode(NAME, ros_time)
        self._simulation = simulation
        self._ros_time = ros_time
        self._pending = pending
        self._clock = self.node.create_publisher(ClockMessage, "/clock", 10)
        self.node.create_timer(REPEAT_S, self._repeat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        group = ReentrantCallbackGroup()  # Other requests are served while one request waits for its steps to finish.
        for kind, name, serve in (
            (SetPause, "set_pause", self._set_pause),
            (StepSimulation, "step_simulation", self._step),
        ):
            self.node.create_service(kind, f"~/{name}", serve, qos_profile=EVERY_CALL, callback_group=group)

    def advance(self, stamp: Time) -> None:
        """Set the time of the nodes in this process, then publish it on /clock."""
        self._ros_time.advance(stamp)
        self._clock.publish(ClockMessage(clock=stamp))

    def _repeat(self) -> None:
        if self._simulation.paused:
            self._clock.publish(ClockMessage(clock=self._ros_time.clock.now().to_msg()))

    def _set_pause(self, request: SetPause.Request, response: SetPause.Response) -> SetPause.Response:
        self._simulation.pause(request.paused)
        response.success, response.message = True, "paused" if request.paused else "running"
        return response

    async def _step(self, request: Any, response: StepSimulation.Response) -> StepSimulation.Response:
        try:
            await self._pending.result(self._simulation.step(request.steps))
            response.success, response.message = True, f"{request.steps} cycles"
        except Exception as error:
            response.success, response.message = False, str(error)
        return response

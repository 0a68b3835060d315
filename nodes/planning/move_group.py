"""The move_group node: MoveIt's interfaces for one robot."""

from collections.abc import Callable
from typing import Final

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_msgs.msg import String

from nodes.only_one import CHECK_S, Discovery, Seniority, nodes_in_graph
from nodes.pick_place.waiter import Waiter
from nodes.planning.controllers import controllers
from nodes.planning.conversion.semantic import srdf_text
from nodes.planning.execution import Execution
from nodes.planning.joint_monitor import JointMonitor
from nodes.planning.move_action import MoveActions, Planning
from nodes.planning.query_services import QueryServices
from nodes.planning.requests import PIPELINE, Requests
from nodes.planning.routes import Route
from nodes.planning.workers import Workers
from nodes.planning.world_store import WorldStore
from nodes.publishing import LATCHED
from planning.robot import PlanningRobot

NAME: Final = "move_group"
"""Name of the node to which MoveIt's clients connect."""
STOP_TOPIC: Final = "trajectory_execution_event"
"""Topic on which RViz requests that all motions stop."""
POLL_S: Final = 0.05
"""Period of the checks for motions that are still running at shutdown, in seconds."""
END_S: Final = 12.0
"""Maximum time for all motions to stop when the program exits, in seconds."""


class MoveGroupNode:
    """All interfaces of move_group. All callbacks run in the executor's only thread."""

    def __init__(
        self, node: Node, robot: PlanningRobot, routes: tuple[Route, ...], on_other: Callable[[], None]
    ) -> None:
        self._node = node
        self._on_other = on_other
        self._seniority = Seniority()
        self._waiter = Waiter(node)
        self._declare(robot)
        self._workers = Workers(node)
        joints = JointMonitor(node, robot)
        store = WorldStore(node, robot, joints)
        execution = Execution(node, robot, store, self._workers)
        execution.controllers = controllers(node, routes, joints)
        planning = Planning(node, Requests(robot), store, self._workers)
        self._queries = QueryServices(node, planning, store, joints, self._workers)
        group = ReentrantCallbackGroup()
        node.create_subscription(String, STOP_TOPIC, self._on_event, 10, callback_group=group)
        node.create_timer(CHECK_S, self._look_for_others, callback_group=group)
        # The actions are created last, because clients wait for /move_action.
        self._actions = MoveActions(node, planning, execution)

    async def stop(self, reason: str) -> None:
        """Reject new goals, brake all motions along their paths, and wait until they have stopped."""
        self._actions.close("PREEMPTED", reason)
        for _ in range(round(END_S / POLL_S)):
            if self._actions.is_idle:
                break
            await self._waiter.until(POLL_S)
        self._workers.close()

    def _declare(self, robot: PlanningRobot) -> None:
        """Declare the parameters that MoveIt's clients read, and publish the groups."""
        semantic = srdf_text(robot)
        values = {
            "robot_description": robot.description.xml,
            "robot_description_semantic": semantic,
            "planning_pipelines": [PIPELINE],
            "default_planning_pipeline": PIPELINE,
        }
        for name, value in values.items():
            self._node.declare_parameter(name, value)
        self._semantic = self._node.create_publisher(String, "robot_description_semantic", LATCHED)
        self._semantic.publish(String(data=semantic))

    def _on_event(self, message: String) -> None:
        if message.data == "stop":
            topic = self._node.resolve_topic_name(STOP_TOPIC)
            self._node.get_logger().info(f"stopping all motions: {topic}")
            self._actions.stop_all("PREEMPTED", f"the motion was stopped by {topic}")

    def _look_for_others(self) -> None:
        if self._seniority.check(nodes_in_graph(self._node, NAME)) is not Discovery.ALONE:
            self._on_other()

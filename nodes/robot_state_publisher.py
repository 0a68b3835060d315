"""Publish ``robot_description``, ``/tf`` and ``/tf_static`` for the links of the arm and the objects in the scene.

The node behaves like ROS 2's robot_state_publisher, with four differences. The node reads the joint states within the
process instead of subscribing to a topic. Changing ``frame_prefix`` also affects the fixed links. The default of
``frame_prefix`` is the namespace, because all namespaces share ``/tf``. The ``robot_description`` cannot be changed,
because the stack drives the robot with which it was started.
"""

from collections.abc import Sequence
from typing import Annotated, Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from controller.broadcasters.joint_state_broadcaster import JointStates
from controller.manager.controllers_file import HONORED
from drivers.printable import printable
from hal.plausible import Rate
from hal.yaml_file import error_text
from nodes.namespace import frame_prefix
from nodes.parameter_node import ParameterNode
from nodes.publishing import LATCHED, RateLimiter
from nodes.ros_time import RosTime
from nodes.stack import Stack
from nodes.transforms import MovingTransforms, fixed_transforms, transform_message

NAME: Final = "robot_state_publisher"

_BASE: Final = "base_link"
_IDLE_SCENE_HZ: Final = 1.0
"""Rate at which the scene is read while /tf has no subscribers, in Hz. The scene feed disconnects if no program reads
it."""


class RobotStateParameters(BaseModel):
    """Parameters of the node, with the same names as in ROS 2. The controllers file may set these parameters in a
    ``robot_state_publisher`` section."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    publish_frequency: Annotated[Rate, Field(gt=0, le=1000.0)] = 20.0
    frame_prefix: str = ""
    ignore_timestamp: bool = False


class RobotStatePublisher:
    """Publishes fixed joints once, and moving joints after each cycle, but no more often than
    ``publish_frequency``."""

    def __init__(self, stack: Stack, ros_time: RosTime) -> None:
        self.node = ParameterNode(NAME, ros_time)
        self._stack = stack
        self._parameters = self._initial()
        self._rate_limiter, self._idle = RateLimiter(), RateLimiter()
        self._tf = self.node.create_publisher(TFMessage, "/tf", 100)
        self._tf_static = self.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._description = self.node.create_publisher(String, "robot_description", LATCHED)
        self._description.publish(String(data=stack.description.xml))
        self._declare()
        self._prepare_transforms()

    def publish(self, states: Sequence[JointStates], stamp: Time) -> None:
        """Publish the moving links at the positions that the broadcasters measured in one cycle, and the objects of the
        simulated scene."""
        stamp_s = states[0].stamp_s
        due = self._rate_limiter.due(stamp_s, self._parameters.publish_frequency)
        if not (due or self._parameters.ignore_timestamp):
            return
        if not self._tf.get_subscription_count():
            if self._idle.due(stamp_s, _IDLE_SCENE_HZ):
                self._stack.scene()
            return
        positions = _positions(states)
        moving = self._moving.transforms(tuple(positions), list(positions.values()), stamp)
        transforms = moving + self._scene(stamp)
        if transforms:
            self._tf.publish(TFMessage(transforms=transforms))

    def _scene(self, stamp: Time) -> list[TransformStamped]:
        prefix = self._parameters.frame_prefix
        return [
            transform_message(prefix + _BASE, prefix + name, *pose, stamp) for name, pose in self._stack.scene().items()
        ]

    def _initial(self) -> RobotStateParameters:
        default = {"frame_prefix": frame_prefix(self._stack.namespace)}
        given = self._stack.factory.file.parameters(NAME)
        for name in sorted(given.keys() - RobotStateParameters.model_fields.keys() - set(HONORED)):
            self.node.get_logger().warning(printable(f"parameter without effect: {name}"))
        try:
            return RobotStateParameters.model_validate(default | given)
        except ValidationError as error:
            self.node.get_logger().error(printable(f"{_describe(error)}: using the default parameters"))
            return RobotStateParameters.model_validate(default)

    def _declare(self) -> None:
        self.node.declare_parameter("robot_description", self._stack.description.xml)
        for name, value in self._parameters:
            self.node.declare_parameter(name, value)
        self.node.add_on_set_parameters_callback(self._check)
        self.node.add_post_set_parameters_callback(self._apply)

    def _changed(self, parameters: list[Parameter]) -> RobotStateParameters:
        return RobotStateParameters.model_validate({**dict(self._parameters), **{p.name: p.value for p in parameters}})

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        own = self._stack.description.xml
        if any(p.name == "robot_description" and p.value != own for p in parameters):
            reason = "the stack drives the robot with which it was started: restart the stack with the other URDF"
            return SetParametersResult(successful=False, reason=reason)
        try:
            self._changed(parameters)
        except ValidationError as error:
            return SetParametersResult(successful=False, reason=_describe(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        before, self._parameters = self._parameters, self._changed(parameters)
        self._rate_limiter = RateLimiter()
        if self._parameters.frame_prefix != before.frame_prefix:
            self._prepare_transforms()

    def _prepare_transforms(self) -> None:
        """Prepare the moving links and publish the fixed ones."""
        joints, prefix = self._stack.description.joints, self._parameters.frame_prefix
        self._moving = MovingTransforms(joints.values(), prefix)
        stamp = self.node.get_clock().now().to_msg()
        self._tf_static.publish(TFMessage(transforms=fixed_transforms(joints, prefix, stamp)))


def _positions(states: Sequence[JointStates]) -> dict[str, float]:
    """Return the position of each joint. The position is NaN if no broadcaster measures it."""
    found: dict[str, float] = {}
    for one in states:
        for name, position in zip(one.names, one.position.tolist(), strict=True):
            if name not in found or position == position:  # A position that is not NaN takes precedence.
                found[name] = position
    return found


def _describe(error: ValidationError) -> str:
    return "; ".join(f"{item['loc'][0]}: {error_text(item)}" for item in error.errors())

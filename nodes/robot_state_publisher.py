"""``robot_description``, ``/tf`` and ``/tf_static``: the arm's links, and the scene's objects.

As upstream's node of this name, but for three things: the joint states come from within the process and not by topic,
``frame_prefix`` acts on the fixed links too when it is set, and the ``robot_description`` cannot be changed, because
the stack drives the robot that it was started with.
"""

from typing import Annotated, Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from controller.broadcasters.joint_state_broadcaster import JointStates
from controller.manager.node_parameters import parameters_of
from drivers.printable import printable
from hal.plausible import Rate
from hal.yaml_file import error_text
from nodes.parameter_node import ParameterNode
from nodes.publishing import LATCHED, RateLimiter
from nodes.ros_time import RosTime
from nodes.stack import Stack
from nodes.transforms import MovingTransforms, fixed_transforms, transform_message

NAME: Final = "robot_state_publisher"

_BASE: Final = "base_link"
_LOOK_HZ: Final = 1.0
"""So often the scene is looked at when nobody listens: a feed that is left unread for long hangs up."""


class RobotStateParameters(BaseModel):
    """Under upstream's names; the controllers file may give them in a section ``robot_state_publisher``."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    publish_frequency: Annotated[Rate, Field(gt=0, le=1000.0)] = 20.0
    frame_prefix: str = ""
    ignore_timestamp: bool = False


class RobotStatePublisher:
    """Fixed joints once, the others after each cycle, at most ``publish_frequency`` times a second."""

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

    def publish(self, states: JointStates, stamp: Time) -> None:
        """The moving links at the measured positions, and what the simulation sees."""
        due = self._rate_limiter.due(states.stamp_s, self._parameters.publish_frequency)
        if not (due or self._parameters.ignore_timestamp):
            return
        if not self._tf.get_subscription_count():
            if self._idle.due(states.stamp_s, _LOOK_HZ):
                self._stack.scene()
            return
        transforms = self._moving.transforms(states.names, states.position.tolist(), stamp) + self._scene(stamp)
        if transforms:
            self._tf.publish(TFMessage(transforms=transforms))

    def _scene(self, stamp: Time) -> list[TransformStamped]:
        prefix = self._parameters.frame_prefix
        return [
            transform_message(prefix + _BASE, prefix + name, *pose, stamp) for name, pose in self._stack.scene().items()
        ]

    def _initial(self) -> RobotStateParameters:
        try:
            return RobotStateParameters.model_validate(parameters_of(self._stack.factory.file.content, NAME))
        except ValidationError as error:
            self.node.get_logger().error(printable(f"{_words(error)}: going with upstream's defaults"))
            return RobotStateParameters()

    def _declare(self) -> None:
        self.node.declare_parameter("robot_description", self._stack.description.xml)
        for name, value in self._parameters:
            self.node.declare_parameter(name, value)
        self.node.add_on_set_parameters_callback(self._check)
        self.node.add_post_set_parameters_callback(self._take)

    def _changed(self, parameters: list[Parameter]) -> RobotStateParameters:
        return RobotStateParameters.model_validate({**dict(self._parameters), **{p.name: p.value for p in parameters}})

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        own = self._stack.description.xml
        if any(p.name == "robot_description" and p.value != own for p in parameters):
            reason = "the stack drives the robot that it was started with: end it and start it with the other URDF"
            return SetParametersResult(successful=False, reason=reason)
        try:
            self._changed(parameters)
        except ValidationError as error:
            return SetParametersResult(successful=False, reason=_words(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: list[Parameter]) -> None:
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


def _words(error: ValidationError) -> str:
    return "; ".join(f"{item['loc'][0]}: {error_text(item)}" for item in error.errors())

"""A robot for the tests of MoveIt's interfaces, and messages of objects."""

from functools import cache

from geometry_msgs.msg import Point, Pose, Quaternion
from moveit_msgs.msg import CollisionObject
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from planning.robot import PlanningRobot
from servoloop.api.options import ArmOptions
from servoloop.motion_planning.robot import planning_robot

READY = {
    "joint1": 0.0, "joint2": -0.3643, "joint3": -0.6419, "joint4": -0.8154, "joint5": -0.9541, "joint6": -1.6828,
    "hand_right_joint": 0.0,
}  # fmt: skip


@cache
def robot_arm() -> PlanningRobot:
    """Return the robot of the arm folder robot_arm."""
    return planning_robot(ArmOptions("robot_arm").files())


def at(x: float, y: float, z: float, turned: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """Return a pose from a position in m and a quaternion x, y, z, w."""
    qx, qy, qz, qw = turned
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def box(name: str, pose: Pose, side_m: float = 0.05, frame: str = "base_link") -> CollisionObject:
    """Return the message that adds a cube."""
    shape = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[side_m] * 3)
    return CollisionObject(
        header=Header(frame_id=frame), id=name, pose=pose, primitives=[shape], primitive_poses=[Pose()]
    )

"""Robots of the planning tests."""

from functools import cache

from hal.types import JointLimits
from planning.robot import PlanningRobot
from planning.srdf_file import read_pairs, read_srdf
from tests.planning.chains import ROOT, description, model

SRDF = ROOT / "config/moveit/robot_arm.srdf"
DRIVEN = (*(f"joint{number}" for number in range(1, 7)), "hand_right_joint")


@cache
def robot_arm() -> PlanningRobot:
    """Return the arm with six joints and a hand, whose left finger follows the right one."""
    joints = description("robot_arm").joints
    limits: dict[str, JointLimits] = {name: joints[name].limits(acceleration=4.0, jerk=40.0) for name in DRIVEN}
    groups, pairs = read_srdf(SRDF, description("robot_arm")), read_pairs(SRDF)
    touching = [links for links, why in pairs.items() if why != "Never"]
    return PlanningRobot(model("robot_arm"), description("robot_arm"), limits, groups, touching)

"""``servoloop goto``: move the tool to a pose while avoiding the obstacles known to move_group."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from servoloop.commands.planning.planner import PoseOptions, move_group, pose_of
from servoloop.commands.shared.option_groups import grouped_options

if TYPE_CHECKING:
    from hal.robot_description.description import Description
    from planning.groups import Group

ARM: Final = "arm"
"""Name of the group that moves to the pose, if more than one group has a tool."""
PLANNING_TIME_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class MotionOptions:
    """Options for a motion."""

    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Fraction of the velocity and acceleration limits.")
    ] = 0.5
    plan_only: Annotated[bool, typer.Option("--plan-only", help="Plan the motion without moving the arm.")] = False


@grouped_options
def goto(
    *,
    x: Annotated[float, typer.Argument(help="x position of the tool, in m.")],
    y: Annotated[float, typer.Argument(help="y position of the tool, in m.")],
    z: Annotated[float, typer.Argument(help="z position of the tool, in m.")],
    pose: PoseOptions,
    motion: MotionOptions,
) -> None:
    """Move the tool to a pose while avoiding all known obstacles.

    Without `--rpy`, the tool may have any orientation. The command needs a motion planner: `servoloop up --plan`,
    `servoloop plan-server` or MoveIt. Example: `servoloop goto 0.25 0.1 0.2 --rpy 0 3.14 0`
    """
    with move_group("goto", pose.network, pose.namespace) as client:
        from hal.robot_description.description import parse_urdf
        from hal.rotations import quaternions
        from nodes.planning_client.goals import motion_goal, pose_constraints
        from planning.srdf_file import parse_srdf

        target = pose_of((x, y, z), pose.rpy)
        urdf, srdf = client.descriptions()
        description = parse_urdf(urdf, "the URDF of move_group")
        group = _tool_group(list(parse_srdf(srdf, description, "the SRDF of move_group").groups.values()))
        quaternion = None if pose.rpy is None else quaternions(target.matrix).tolist()
        frame = pose.frame or _root(description)
        constraints = pose_constraints(str(group.tip), frame, target.position_m.tolist(), quaternion)
        goal = motion_goal(group.name, constraints, motion.speed, PLANNING_TIME_S)
        goal.planning_options.plan_only = motion.plan_only
        planned = client.move(goal)
    done = "a motion is possible" if motion.plan_only else "done: the tool is at the pose"
    typer.echo(f"{done}; {planned.duration_s:.2f} s of motion, planned in {planned.planning_time_s:.2f} s")


def _tool_group(groups: "Sequence[Group]") -> "Group":
    with_tool = [group for group in groups if group.tip is not None]
    if not with_tool:
        raise DriverError("no group of move_group has a tool: add a <chain> to a group in its SRDF")
    return next((group for group in with_tool if group.name == ARM), with_tool[0])


def _root(description: "Description") -> str:
    children = {joint.child for joint in description.joints.values()}
    return next(link for link in description.links if link not in children)

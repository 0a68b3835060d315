"""``servoloop plan-server``: plan motions for MoveIt's clients, alongside a running stack."""

from typing import Annotated

import typer

from drivers.driver_errors import DriverError
from nodes.ros_environment import PLANNING_PACKAGES, require_ros
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import NetworkOption, set_network
from servoloop.extras import require_extras
from servoloop.stack.arm_options import ControlledArm


@grouped_options
def plan_server(
    *,
    arm: ControlledArm,
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Use the clock of a stack that runs in simulated time.")
    ] = False,
    network: NetworkOption = False,
) -> None:
    """Serve MoveIt's actions, services and topics alongside a running stack, until Ctrl-C.

    The node is named move_group, and MoveIt's clients connect to it. Do not run MoveIt at the same time.
    Example: `servoloop plan-server --arm so101`
    """
    require_extras("motion planning", "planning")
    require_ros(PLANNING_PACKAGES)
    set_network(network)
    from nodes.planning.process import ServerSettings, run
    from planning.collision import warm_up
    from planning.planning_errors import PlanningError
    from servoloop.motion_planning.robot import planning_robot
    from servoloop.motion_planning.routes import routes

    files = arm.read()
    try:
        robot = planning_robot(files)
    except PlanningError as error:
        raise DriverError(str(error)) from None
    warm_up()

    def ready() -> None:
        typer.echo(
            f"ready: planning for {files.arm} as {files.namespace}/move_group, groups {', '.join(robot.groups.groups)}"
        )

    raise typer.Exit(run(robot, routes(files), ready, ServerSettings(files.namespace, sim_time)))

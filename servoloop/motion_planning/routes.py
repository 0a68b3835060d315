"""List the controllers of an arm that the planning server uses."""

from controller.forward.commands import ForwardParameters
from controller.gripper.goal import GripperParameters
from controller.gripper.gripper_action_controller import GripperActionController
from controller.manager.controller_spec import ControllerSpec
from controller.trajectory.parameters import TrajectoryParameters
from nodes.planning.routes import Route
from servoloop.stack.robot_files import Files


def routes(files: Files) -> tuple[Route, ...]:
    """Return the controllers in the controllers file that can follow trajectories, and their joints."""
    return tuple(route for spec in files.controllers.controllers if (route := _route(spec)) is not None)


def _route(spec: ControllerSpec) -> Route | None:
    parameters = spec.parameters
    if isinstance(parameters, TrajectoryParameters):
        return Route(spec.name, "trajectory", tuple(parameters.joints))
    if isinstance(parameters, GripperParameters):
        is_parallel = spec.kind == GripperActionController.kind
        return Route(spec.name, "parallel_gripper" if is_parallel else "gripper", (parameters.joint,))
    if isinstance(parameters, ForwardParameters) and parameters.interface_name == "position":
        return Route(spec.name, "forward", tuple(parameters.joints))
    return None

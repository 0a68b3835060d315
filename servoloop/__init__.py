"""Control robot arms on serial bus servos: the Python interface, the command line and the control stack.

``from servoloop import Arm`` is the Python interface. The interface is loaded on first use, because the command line
does not need it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from servoloop.api.arm import Arm
    from servoloop.api.arm_errors import (
        ArmBusyError,
        ArmEndedError,
        ArmError,
        ArmInputError,
        ArmSetupError,
        ArmTimeoutError,
        MotionCanceledError,
        MotionFailedError,
        PlanFailedError,
        StreamEndedError,
    )
    from servoloop.api.backend import ArmState
    from servoloop.api.motion import ArmMotion, TargetStream
    from servoloop.api.planning.motion_planner import MotionPlanner
    from servoloop.api.planning.pose import ArmPose
    from servoloop.api.trajectory import ArmTrajectory

__all__ = [
    "Arm",
    "ArmBusyError",
    "ArmEndedError",
    "ArmError",
    "ArmInputError",
    "ArmMotion",
    "ArmPose",
    "ArmSetupError",
    "ArmState",
    "ArmTimeoutError",
    "ArmTrajectory",
    "MotionCanceledError",
    "MotionFailedError",
    "MotionPlanner",
    "PlanFailedError",
    "StreamEndedError",
    "TargetStream",
]

_MODULES = {
    "Arm": "arm",
    "ArmMotion": "motion",
    "ArmPose": "planning.pose",
    "ArmState": "backend",
    "ArmTrajectory": "trajectory",
    "MotionPlanner": "planning.motion_planner",
    "TargetStream": "motion",
}


def __getattr__(name: str) -> Any:
    """Load a name from the Python interface when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"servoloop.api.{_MODULES.get(name, 'arm_errors')}"), name)

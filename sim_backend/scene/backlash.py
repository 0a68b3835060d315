"""Backlash between motor and link. The motor is a separate joint and pushes the link only at the ends of the gap.

The encoder of a serial bus servo is on the output shaft, so it measures the link position. The back-EMF depends on the
motor speed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import mujoco

from sim_backend.scene.scene_file import scene_spec

OUTPUT_SHARE: Final = 0.1
"""Fraction of the rotor and gear inertia and friction that is on the link's side of the gap: horn and last gear wheel
(assumed)."""
TEETH_SOLREF: Final = (0.004, 1.0)
"""Stiffness of the teeth, as a time constant (s) and a damping ratio. The other stiff parts of the scene have the same
values."""
_MASS_KG: Final = 0.001
_INERTIA_KG_M2: Final = 1e-6
"""Mass and inertia that MuJoCo requires. They are negligible compared with the reflected rotor inertia."""


def motor_name(joint: str) -> str:
    """Return the name of the motor joint."""
    return f"{joint}_motor"


def with_gaps(scene: Path, gaps: Mapping[str, float]) -> Any:
    """Return the scene specification with a motor for each joint in ``gaps``, which contains the free travel (rad or
    m).

    Raises ArmFileError.
    """
    spec: Any = scene_spec(scene)
    for joint, gap in gaps.items():
        _add_motor(spec, joint, gap)
    if gaps:  # The motor joints come after all other joints.
        for key in spec.keys:
            key.qpos = [*key.qpos, *(0.0 for _ in gaps)]
    return spec


def _add_motor(spec: Any, name: str, gap: float) -> None:
    """Move the actuator, and most of the joint's inertia and friction, to a motor."""
    link = spec.joint(name)
    body = spec.worldbody.add_body(
        name=motor_name(name), mass=_MASS_KG, inertia=[_INERTIA_KG_M2] * 3, explicitinertial=True
    )
    # Any horizontal axis is suitable, if gravity neither pulls along this axis nor turns the body around it.
    motor = body.add_joint(name=motor_name(name), type=link.type, axis=[1.0, 0.0, 0.0])
    motor.armature, link.armature = (1.0 - OUTPUT_SHARE) * link.armature, OUTPUT_SHARE * link.armature
    motor.damping, link.damping = (1.0 - OUTPUT_SHARE) * link.damping, OUTPUT_SHARE * link.damping
    motor.frictionloss, link.frictionloss = (1.0 - OUTPUT_SHARE) * link.frictionloss, OUTPUT_SHARE * link.frictionloss
    spec.actuator(name).target = motor_name(name)
    teeth = spec.add_tendon(name=motor_name(name), range=[-0.5 * gap, 0.5 * gap])
    teeth.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    teeth.solref_limit = list(TEETH_SOLREF)
    teeth.wrap_joint(name, 1.0)
    teeth.wrap_joint(motor_name(name), -1.0)

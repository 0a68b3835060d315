"""A gap between motor and link, as gears have it: the motor is a joint of its own, and pushes at the gap's ends alone.

The encoder of a serial bus servo sits on the output shaft, so what it sees is the link; the back-EMF is the motor's.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import mujoco

from sim_backend.scene.scene_file import scene_spec

OUTPUT_SHARE: Final = 0.1
"""Of rotor, gears and their friction behind the gap: the horn and the last wheel (assumed)."""
TEETH_SOLREF: Final = (0.004, 1.0)
"""How stiff teeth are: a time constant (s) and a damping ratio; as stiff as the scene's other stiff parts."""
_MASS_KG: Final = 0.001
_INERTIA_KG_M2: Final = 1e-6
"""MuJoCo wants some of both; next to a rotor seen through its gears they are nothing."""


def motor_name(joint: str) -> str:
    """What the motor's own joint is called."""
    return f"{joint}_motor"


def with_gaps(scene: Path, gaps: Mapping[str, float]) -> Any:
    """The scene as a specification, with a motor for each joint in ``gaps``: how far it is free (rad or m).

    Raises ArmFileError.
    """
    spec: Any = scene_spec(scene)
    for joint, gap in gaps.items():
        _add_motor(spec, joint, gap)
    if gaps:  # the motors' joints are behind all others
        for key in spec.keys:
            key.qpos = [*key.qpos, *(0.0 for _ in gaps)]
    return spec


def _add_motor(spec: Any, name: str, gap: float) -> None:
    """Most of the joint's inertia and friction, and its actuator, go to the motor."""
    link = spec.joint(name)
    body = spec.worldbody.add_body(
        name=motor_name(name), mass=_MASS_KG, inertia=[_INERTIA_KG_M2] * 3, explicitinertial=True
    )
    # Any horizontal axis: no gravity along it, and none that would turn a body about its own middle.
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

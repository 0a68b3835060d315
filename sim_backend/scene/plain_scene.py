"""Scene of a single arm, generated from its robot description: links, motors, table, light and camera.

Primitive shapes of the description are kept. A link without primitive shapes becomes a stick between its joints,
because MuJoCo cannot read all mesh formats, and contacts between meshes would be slow to compute.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from hal.hal_errors import DescriptionError
from sim_backend.mechanics.motor import GEAR_DAMPING_NM_S, GEAR_FRICTION_NM, ROTOR_INERTIA_KG_M2
from sim_backend.scene.cube_cell import FloatArray
from sim_backend.scene.overview import overview_camera
from sim_backend.scene.picture import CAMERA
from sim_backend.scene.world import READY, place_followers

TIMESTEP_S: Final = 0.001
LIGHTEST_KG: Final = 1e-6
"""Mass of a link for which the description does not specify a mass, in kg. MuJoCo does not move a body without mass."""
SMALLEST_KG_M2: Final = 1e-12
STICK_M: Final = 0.012
"""Radius of a stick, in meters."""
SHORTEST_M: Final = 0.01
"""Minimum length of a stick, in meters. Shorter sticks are omitted."""
PRIMITIVES: Final = ("box", "cylinder", "sphere")
TABLE_RGBA: Final = (0.86, 0.87, 0.88, 1.0)
ARM_RGBA: Final = (0.96, 0.76, 0.16, 1.0)
CAMERA_FROM: Final = np.array([0.77, -0.52, 0.44])
"""Direction from the center of the arm to the camera."""
CAMERA_REACHES: Final = 2.6
"""Camera distance, as a multiple of the arm's size."""
FOVY_DEG: Final = 40.0


def plain_scene(urdf_xml: str, servos: Mapping[str, float]) -> str:
    """Return the MJCF of a scene.

    ``servos`` contains the joint displacement per radian of the servo's shaft, keyed by driven joint. The last joint is
    the hand's joint. Raises DescriptionError if MuJoCo cannot read the description.
    """
    try:
        spec: Any = mujoco.MjSpec.from_string(_with_primitives(urdf_xml))
        _set_up(spec, servos)
        pose = _first_pose(spec.compile())
        model = _finished(spec, pose)
    except (ValueError, KeyError) as error:
        raise DescriptionError(f"MuJoCo cannot read the URDF: {' '.join(str(error).split())}") from error
    assert model.nu == len(servos)
    return str(spec.to_xml())


def _with_primitives(urdf_xml: str) -> str:
    """Return the description with only primitive shapes, and with a mass for each link."""
    robot = ElementTree.fromstring(urdf_xml)
    for link in robot.findall("link"):
        shapes = [_primitive(shape) for shape in (*link.findall("collision"), *link.findall("visual"))]
        collisions = [shape for shape in shapes[: len(link.findall("collision"))] if shape is not None]
        kept = collisions or [shape for shape in shapes if shape is not None]
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
        link.extend(kept)
    for other in ("mujoco", "gazebo", "transmission"):
        for element in robot.findall(other):
            robot.remove(element)
    bounds = {"boundmass": str(LIGHTEST_KG), "boundinertia": str(SMALLEST_KG_M2)}
    ElementTree.SubElement(
        ElementTree.SubElement(robot, "mujoco"), "compiler", {"fusestatic": "false", "balanceinertia": "true", **bounds}
    )
    return ElementTree.tostring(robot, encoding="unicode")


def _primitive(shape: Element) -> Element | None:
    """Return the shape as a collision element, or None for a mesh."""
    geometry = shape.find("geometry")
    if geometry is None or not any(geometry.find(kind) is not None for kind in PRIMITIVES):
        return None
    made = Element("collision")
    made.extend(part for part in (shape.find("origin"), geometry) if part is not None)
    return made


def _set_up(spec: Any, servos: Mapping[str, float]) -> None:
    """Add gears and motors to the joints. Links collide with the table but not with each other."""
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in spec.joints:
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # The motor of the servo limits the effort.
        ratio = servos.get(joint.name, 1.0) ** 2
        joint.armature = ROTOR_INERTIA_KG_M2 / ratio if joint.name in servos else 0.0
        joint.damping = [GEAR_DAMPING_NM_S / ratio, 0.0, 0.0]
        joint.frictionloss = GEAR_FRICTION_NM / servos[joint.name] if joint.name in servos else 0.0
    for name in servos:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
    for body in spec.bodies[1:]:
        _add_sticks(body)
        for geom in body.geoms:
            geom.contype, geom.conaffinity, geom.rgba = 1, 0, ARM_RGBA


def _add_sticks(body: Any) -> None:
    """For a link that has no shape, add sticks between its joints."""
    if body.geoms:
        return
    ends = [np.array(child.pos) for child in body.bodies] or [2.0 * np.array(body.ipos)]
    for end in ends:
        if np.linalg.norm(end) >= SHORTEST_M:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0.0, 0.0, 0.0, *end], size=[STICK_M, 0.0, 0.0], mass=0.0
            )


def _first_pose(model: Any) -> FloatArray:
    """Return MuJoCo's positions with each joint at zero, or at the center of its range if the range does not include
    zero."""
    pose: FloatArray = model.qpos0.copy()
    for joint in range(model.njnt):
        low, high = model.jnt_range[joint]
        if model.jnt_limited[joint] and not low <= 0.0 <= high:
            pose[model.jnt_qposadr[joint]] = 0.5 * (low + high)
    place_followers(model, pose)
    return pose


def _finished(spec: Any, pose: FloatArray) -> Any:
    """Add the table, the light, the camera and the keyframe with the initial pose. Return the compiled scene."""
    model: Any = spec.compile()
    data: Any = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    low, high = data.xpos[1:].min(axis=0), data.xpos[1:].max(axis=0)
    middle, size = 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 0.1)
    table = spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1])
    table.pos = [0.0, 0.0, _table_m(model, data)]
    table.contype, table.conaffinity, table.rgba = 0, 1, TABLE_RGBA
    spec.worldbody.add_light(pos=[*(middle[:2] + size), middle[2] + 2.0 * size])
    spec.worldbody.add_camera(name=CAMERA, fovy=FOVY_DEG, **overview_camera(middle, CAMERA_FROM, CAMERA_REACHES * size))
    spec.add_key(name=READY, qpos=pose)
    return spec.compile()


def _table_m(model: Any, data: Any) -> float:
    """Return the table height: the height of the arm's base, or less if a moving link would otherwise start inside the
    table."""
    moving = np.flatnonzero(model.body_weldid[model.geom_bodyid] != 0)
    lowest = (data.geom_xpos[moving, 2] - model.geom_rbound[moving]).min(initial=0.0)
    return float(min(0.0, lowest))

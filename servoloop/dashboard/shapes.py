"""Read the shapes of an arm's links and of the objects in its scene, as triangles."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
import trimesh

from hal.file_size import LARGEST_SHAPE_BYTES, REDUCE, check_size
from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion, from_rpy
from hal.robot_description.link_meshes import LinkMesh, link_meshes, read_stl, with_edges
from hal.types import FloatArray
from sim_backend.arm_names import arm_prefixes
from sim_backend.scene.scene_file import scene_model

Rgb = tuple[int, int, int]
GRAY: Rgb = (150, 152, 156)
ORIGIN = Element("origin")


class MeshTooLarge(Exception):
    """A mesh in a robot description is too large to be drawn."""


@dataclass(frozen=True, slots=True)
class DrawnShape:
    """Visual of a link: triangles and their pose in the link's frame, in meters."""

    link: str
    vertices: FloatArray
    faces: "np.ndarray[Any, np.dtype[np.int64]]"
    position_m: Vector
    quaternion: Quaternion
    rgb: Rgb
    flat: bool
    """Whether the shape has flat faces and sharp edges."""


def shapes(xml: str, folder: Path | None = None) -> tuple[list[DrawnShape], list[str]]:
    """Return the visuals of all links of a URDF, and the names of meshes and shapes that cannot be read.

    ``folder`` is the folder of the URDF and is used to resolve relative mesh paths.
    """
    robot = ElementTree.fromstring(xml)
    colors = {name: rgb for one in robot.iter("material") if (name := one.get("name")) and (rgb := _color(one))}
    found: list[DrawnShape] = []
    missing: list[str] = []
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            geometry = next(iter(visual.find("geometry") or ()), None)
            if geometry is None:
                continue
            try:
                found.append(_visual(link.get("name", ""), visual, _mesh(geometry, folder), colors))
            except MeshTooLarge as reason:
                missing.append(str(reason))
            except Exception:  # trimesh and its optional readers raise errors of many types
                missing.append(geometry.get("filename", geometry.tag))
    return found, missing


def _visual(link: str, visual: Element, mesh: trimesh.Trimesh, colors: Mapping[str, Rgb]) -> DrawnShape:
    """Return the visual of a link with its mesh. Raises ValueError if the mesh is empty or a number is invalid."""
    vertices = np.asarray(mesh.vertices, np.float64)
    if not len(vertices) or not np.isfinite(vertices).all():
        raise ValueError("the mesh has no vertices, or vertices that are not finite")
    origin = visual.find("origin")
    place = ORIGIN if origin is None else origin
    return DrawnShape(
        link,
        vertices,
        np.asarray(mesh.faces, np.int64),
        _vector(place.get("xyz", "0 0 0")),
        from_rpy(_vector(place.get("rpy", "0 0 0"))),
        _rgb(visual, colors),
        visual.find("geometry/box") is not None,
    )


def arm_shapes(xml: str, urdf_folder: Path, scene_folder: Path) -> tuple[list[DrawnShape], list[str]]:
    """Read the shapes of an arm's links from ``meshes/``, or from the URDF for links without such a mesh.

    Args:
        xml: URDF of the arm.
        urdf_folder: Folder of the URDF.
        scene_folder: Folder of the arm's scene, which may contain ``meshes/``.

    Returns:
        The shapes, and the names of the URDF's meshes that cannot be read.

    Raises:
        ArmFileError: A file in ``meshes/`` is invalid.
    """
    visuals, missing = shapes(xml, urdf_folder)
    links = {link.get("name", "") for link in ElementTree.fromstring(xml).findall("link")}
    return _with_real_shapes(visuals, [mesh for mesh in link_meshes(scene_folder) if mesh.link in links]), missing


def _with_real_shapes(visuals: Iterable[DrawnShape], meshes: Iterable[LinkMesh]) -> list[DrawnShape]:
    """Return the visuals, with those of some links replaced by meshes."""
    meshes = list(meshes)
    links = {mesh.link for mesh in meshes}
    triangles = {path: with_edges(*read_stl(path)) for path in {mesh.path for mesh in meshes}}
    return [shape for shape in visuals if shape.link not in links] + [
        DrawnShape(mesh.link, *triangles[mesh.path], mesh.position_m, mesh.quaternion, _bytes(mesh.rgb), flat=False)
        for mesh in meshes
    ]


def scene_shapes(path: Path) -> Iterator[DrawnShape]:
    """Yield the fixed boxes of a MuJoCo scene (bins and stand) in the world frame, with the body name as the link."""
    model, data = _scene(path)
    fixed = tuple(f"{prefix}{part}" for prefix in arm_prefixes(model) for part in ("bin_", "stand"))
    for geom, name in _boxes(model):
        if name.startswith(fixed):
            turn = np.empty(4)
            mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
            yield _box(model, geom, name, data.geom_xpos[geom], turn)


def thing_shapes(path: Path) -> Iterator[DrawnShape]:
    """Yield the loose boxes of a MuJoCo scene (the cube) in their body frames, with the body name as the link."""
    model, _ = _scene(path)
    for geom, name in _boxes(model):
        body = model.body(model.geom_bodyid[geom])
        if body.jntnum[0] and model.jnt_type[body.jntadr[0]] == mujoco.mjtJoint.mjJNT_FREE:
            yield _box(model, geom, name, model.geom_pos[geom], model.geom_quat[geom])


def _scene(path: Path) -> tuple[Any, Any]:
    model: Any = scene_model(path)
    data: Any = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def _boxes(model: Any) -> Iterator[tuple[int, str]]:
    """Yield the geom number and the body name of each box."""
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            yield geom, model.body(model.geom_bodyid[geom]).name


def _box(model: Any, geom: int, name: str, position_m: FloatArray, wxyz: FloatArray) -> DrawnShape:
    box = trimesh.creation.box(extents=2.0 * model.geom_size[geom])
    w, x, y, z = wxyz.tolist()
    place: Vector = tuple(position_m.tolist())
    rgb = _bytes(model.geom_rgba[geom][:3].tolist())
    return DrawnShape(name, np.asarray(box.vertices), np.asarray(box.faces), place, (x, y, z, w), rgb, flat=True)


def _mesh(geometry: Element, folder: Path | None) -> trimesh.Trimesh:
    mesh: trimesh.Trimesh
    if geometry.tag == "box":
        mesh = trimesh.creation.box(extents=_vector(geometry.get("size", "")))
    elif geometry.tag == "cylinder":
        mesh = trimesh.creation.cylinder(float(geometry.get("radius", "")), float(geometry.get("length", "")))
    elif geometry.tag == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=float(geometry.get("radius", "")))
    else:
        path = _path(geometry.attrib["filename"], folder)
        check_size(path, MeshTooLarge, LARGEST_SHAPE_BYTES, REDUCE)
        mesh = trimesh.load_mesh(path)
        mesh.vertices = mesh.vertices * _vector(geometry.get("scale", "1 1 1"))
    return mesh


def _path(name: str, folder: Path | None) -> Path:
    """Return the path of a mesh file. Paths in ROS packages are resolved relative to the folder of the URDF."""
    if name.startswith("file://"):
        return Path(name.removeprefix("file://"))
    return (folder or Path()) / name.removeprefix("package://")


def _rgb(visual: Element, colors: Mapping[str, Rgb]) -> Rgb:
    material = visual.find("material")
    if material is None:
        return GRAY
    return _color(material) or colors.get(material.get("name", ""), GRAY)


def _color(material: Element) -> Rgb | None:
    """Return the color of a material, or None if the material has no color or an invalid color."""
    color = material.find("color")
    try:
        rgb = [float(part) for part in color.get("rgba", "").split()[:3]] if color is not None else []
    except ValueError:
        return None
    return _bytes(rgb) if len(rgb) == 3 and all(0.0 <= part <= 1.0 for part in rgb) else None


def _bytes(rgb: Sequence[float]) -> Rgb:
    red, green, blue = (round(255 * part) for part in rgb)
    return red, green, blue


def _vector(text: str) -> Vector:
    x, y, z = (float(part) for part in text.split())
    return x, y, z

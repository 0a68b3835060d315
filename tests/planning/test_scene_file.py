"""Objects come from MoveIt's scene files and from YAML; every mistake is reported with its file and line."""

import re
from pathlib import Path

import numpy as np
import pytest

from planning.mesh_file import MeshFileError, read_mesh
from planning.moveit_scene import parse_moveit_scene
from planning.planning_errors import PlanningError
from planning.scene import Box, Cone, Cylinder, Mesh, Sphere
from planning.scene_file import read_scene_file

NEW = """(noname)+
* my table
0.5 0 0.25
0 0 0 1
2
box
0.4 0.6 0.02
0 0 0.1
0 0 0.70710678 0.70710678
0 0 0 0
cylinder
0.03 0.5
0 0 -0.15
0 0 0 1
0.5 0.5 0.5 1
1
corner
0.2 0.3 0.1
0 0 0 1
* tetrahedron
0 0 0
0 0 0 1
1
mesh
4 4
0 0 0
1 0 0
0 1 0
0 0 1
0 1 2
0 1 3
0 2 3
1 2 3
0 0 0
0 0 0 1
0 0 0 0
0
.
"""
OLD = """scene
* ball
1
sphere
0.1
0.3 0 0.2
0 0 0 1
0 0 0 0
* hat
1
cone
0.1 0.2
0 0 0.1
0 0 0 1
0 0 0 0
.
"""
TETRAHEDRON = """v 100 0 0
v 110 0 0
v 100 10 0
v 100 0 10
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def test_a_scene_of_moveit_in_the_new_format() -> None:
    table, mesh = parse_moveit_scene(NEW, "new.scene")
    assert table.name == "my table" and table.pose.position_m.tolist() == [0.5, 0.0, 0.25]
    (box, at), (leg, _) = table.shapes
    assert (box, leg) == (Box(0.4, 0.6, 0.02), Cylinder(0.5, 0.03))
    assert at.matrix @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-7)
    shape = mesh.shapes[0][0]
    assert isinstance(shape, Mesh) and shape.vertices_m.shape == (4, 3) and shape.triangles.shape == (4, 3)


def test_a_scene_of_moveit_in_the_old_format() -> None:
    ball, hat = parse_moveit_scene(OLD, "old.scene")
    assert ball.shapes[0][0] == Sphere(0.1) and ball.shapes[0][1].position_m.tolist() == [0.3, 0.0, 0.2]
    assert hat.shapes[0][0] == Cone(0.2, 0.1)
    assert parse_moveit_scene("empty\n.\n", "empty.scene") == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.4 0.6 0.02", "0.4 0.6", r"x.scene, line"),
        ("0.4 0.6 0.02", "0.4 zero 0.02", "x.scene, line 7: the size of my table must be 3 numbers, but one is zero"),
        ("0.4 0.6 0.02", "0.4 0 0.02", r'box of object "my table" has size 0.4 x 0 x 0.02 m'),
        ("0.4 0.6 0.02", "0.4 nan 0.02", "x.scene, line 7: the size of my table must be finite"),
        ("0 0 0.70710678 0.70710678", "0 0 0 2", "x.scene, line 9: quaternion .* has length 2"),
        ("box", "plane", "x.scene, line 6: my table has a shape of type plane, which is not supported: replace it"),
        ("4 4", "4 0", "x.scene, line 25: the mesh of tetrahedron has no triangles"),
        ("1 2 3\n", "1 2 9\n", "x.scene, line 33: a triangle of tetrahedron has vertex 9, but the mesh has 4"),
        ("* tetrahedron", "* my table", "x.scene, line 20: two objects are named my table: rename one"),
        ("* tetrahedron", "*", "x.scene, line 20: the object has no name: add a name"),
        ("* tetrahedron", "+ tetrahedron", r"x.scene, line 20: expected \* \(an object\)"),
        ("\n.\n", "\n", "x.scene, line 37: the file ends before .*: complete the file"),
    ],
)
def test_mistakes_of_a_scene_of_moveit_have_their_lines(old: str, new: str, words: str) -> None:
    assert old in NEW
    with pytest.raises(PlanningError, match=words) as caught:
        parse_moveit_scene(NEW.replace(old, new, 1), "x.scene")
    assert "\n" not in str(caught.value)


def test_a_yaml_file_with_one_and_with_several_shapes(tmp_path: Path) -> None:
    (tmp_path / "part.obj").write_text(TETRAHEDRON)
    (tmp_path / "scene.yaml").write_text(
        """objects:
  shelf: {position_m: [0.35, 0, 0.3], rpy_rad: [0, 0, 1.57079633], box: [0.1, 0.3, 0.02]}
  part:
    shapes:
    - {mesh: {file: part.obj, scale: 0.001}}
    - {sphere: {radius_m: 0.02}, position_m: [0, 0, 0.1]}
"""
    )
    shelf, part = read_scene_file(tmp_path / "scene.yaml")
    assert shelf.shapes[0][0] == Box(0.1, 0.3, 0.02)
    assert shelf.pose.matrix @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-7)
    (mesh, _), (sphere, place) = part.shapes
    assert isinstance(mesh, Mesh)
    assert sorted(mesh.vertices_m.round(6).tolist()) == [[0.1, 0, 0], [0.1, 0, 0.01], [0.1, 0.01, 0], [0.11, 0, 0]]
    assert sphere == Sphere(0.02) and place.position_m.tolist() == [0.0, 0.0, 0.1]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("box: [0.1, 0, 0.1]", r"yaml:3: objects.cup.box.1: must be above 0"),
        ("box: [0.1, 0.1]", "objects.cup.box"),
        ("position_m: [0, 0, 0]", "objects.cup: needs either one of box, cylinder"),
        ("{box: [1, 1, 1], sphere: {radius_m: 1}}", "objects.cup: has several shapes"),
        ("{box: [1, 1, 1], quaternion_xyzw: [0, 0, 0, 2]}", "objects.cup: quaternion .* has length 2"),
        ("{box: [1, 1, 1], rpy_rad: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}", "has both rpy_rad and quaternion"),
        ("mesh: {file: cup.stl}", r"mesh file .*cup.stl does not exist: correct the path"),
        ("mesh: {file: cup.dae}", r"cup.dae is neither an STL nor an OBJ file"),
        ("mesh: {file: flat.obj}", r"flat.obj is not a mesh with a volume"),
        ("mesh: {file: text.stl}", r"text.stl is not a mesh with a volume: it is not a binary STL file; save it as a"),
        ("mesh: {file: index.obj}", r"index.obj is not a mesh with a volume: .* does not exist; correct the mesh"),
        ("mesh: {file: large.stl}", "large.stl has 200001 triangles, but at most 200000 are possible: simplify the"),
        (f"mesh: {{file: {'x' * 300}.stl}}", r"cannot read .*xx.stl: File name too long: check the path"),
        ("ball: 3", "objects.cup.ball: is not a known key"),
    ],
)
def test_mistakes_of_a_yaml_file_have_their_lines(tmp_path: Path, entry: str, words: str) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "index.obj").write_text(TETRAHEDRON + "f 1 2 9\n")
    (tmp_path / "text.stl").write_text("solid nothing\nendsolid nothing\n")
    with (tmp_path / "large.stl").open("wb") as file:
        file.write(bytes(80) + (200_001).to_bytes(4, "little"))
        file.truncate(84 + 50 * 200_001)
    (tmp_path / "scene.yaml").write_text(f"objects:\n  cup:\n    {entry}\n")
    with pytest.raises(PlanningError, match=words) as caught:
        read_scene_file(tmp_path / "scene.yaml")
    assert re.search(r"scene\.yaml:[23]: objects\.cup", str(caught.value))


@pytest.mark.parametrize("scale", [0.0, float("nan"), float("inf")])
def test_a_scale_without_a_size_is_refused(tmp_path: Path, scale: float) -> None:
    (tmp_path / "part.obj").write_text(TETRAHEDRON)
    with pytest.raises(PlanningError, match=r"the scale of .*part.obj is (0|nan|inf): use a finite number other than"):
        read_mesh(tmp_path / "part.obj", scale)


@pytest.mark.parametrize("name", ["part.stl", "part.obj"])
def test_a_mesh_file_without_read_permission_is_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The test also runs as root, who may read every file."""

    def refuse(path: Path, *args: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    (tmp_path / name).write_text("solid nothing\nendsolid nothing\n")
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(MeshFileError, match=rf"cannot read .*{name}: Permission denied: check the path and its perm"):
        read_mesh(tmp_path / name)


def test_a_mesh_keeps_the_frame_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_text(TETRAHEDRON)
    mesh = read_mesh(path)
    corners = mesh.vertices_m[mesh.triangles]
    assert corners.shape == (4, 3, 3)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([10.0, 10.0, 10.0])

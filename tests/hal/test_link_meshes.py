"""Tests of link meshes: their poses, their files, and sharp edges."""

import zipfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from hal.file_size import LARGEST_SHAPE_BYTES
from hal.hal_errors import ArmFileError
from hal.robot_description.description import parse_urdf
from hal.robot_description.link_meshes import PLACES, TRIANGLE, Faces, link_meshes, read_stl, with_edges
from hal.types import FloatArray
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.shipped_files import ARMS
from tests.pages import code

OWNED = ("koch", "so100", "so101")
MOST_BYTES = 3_000_000
"""Maximum total size of all meshes in the Python wheel, in bytes."""


def write_stl(path: Path, corners: FloatArray) -> None:
    triangles = np.zeros(len(corners), TRIANGLE)
    triangles["corners"] = corners
    path.write_bytes(b" " * 80 + len(corners).to_bytes(4, "little") + triangles.tobytes())


def cube() -> FloatArray:
    """Return the triangles of a unit cube, shape (12, 3, 3)."""
    found = []
    for axis, side in product(range(3), (0.0, 1.0)):
        corners = np.array([np.insert([1.0 * u, v], axis, side) for u, v in ((0, 0), (0, 1), (1, 1), (1, 0))])
        found += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    turned = np.array([c if np.cross(c[1] - c[0], c[2] - c[0]) @ (c.mean(0) - 0.5) > 0 else c[::-1] for c in found])
    return turned


def tube(sides: int) -> tuple[FloatArray, Faces]:
    """Return the triangles of the round wall of a cylinder."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate([np.insert(circle, 2, z, axis=1) for z in (0.0, 1.0)])
    here, after = np.arange(sides), np.roll(np.arange(sides), -1)
    faces = np.concatenate(
        [np.column_stack([here, after, after + sides]), np.column_stack([here, after + sides, here + sides])]
    )
    return vertices, faces


def test_a_file_is_read_with_each_vertex_once(tmp_path: Path) -> None:
    write_stl(tmp_path / "cube.stl", cube())
    vertices, faces = read_stl(tmp_path / "cube.stl")
    assert vertices.shape == (8, 3) and faces.shape == (12, 3)
    np.testing.assert_allclose(vertices[faces], cube())


def test_an_edge_stays_sharp_and_a_round_wall_stays_smooth(tmp_path: Path) -> None:
    write_stl(tmp_path / "cube.stl", cube())
    vertices, faces = with_edges(*read_stl(tmp_path / "cube.stl"))
    assert len(vertices) == 24, "each corner of the cube belongs to three planes"
    np.testing.assert_allclose(vertices[faces], cube())
    assert len(with_edges(*tube(36))[0]) == 72, "ten degrees between two faces are not an edge"
    assert len(with_edges(*tube(6))[0]) == 24, "sixty degrees are an edge"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"solid cube\n facet normal 0 0 1\n" + b" " * 80, "is not a binary STL file: export the mesh as binary STL"),
        (b"", "is not a binary STL file"),
        (None, "cannot be read: No such file or directory: correct the name in links.yaml"),
    ],
)
def test_invalid_stl_files_are_reported(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "part.stl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ArmFileError) as error:
        read_stl(path)
    assert f"{path} {message}" in str(error.value)


def test_a_vertex_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    corners = cube()
    corners[3, 1, 2] = np.nan
    write_stl(tmp_path / "part.stl", corners)
    with pytest.raises(ArmFileError, match="a vertex that is not finite: export the mesh again"):
        read_stl(tmp_path / "part.stl")


def test_mistakes_in_links_yaml_are_reported_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / PLACES
    path.parent.mkdir()
    path.write_text(
        "links:\n  hand:\n    - {mesh: a.stl, rgb: [1, 1, 2]}\n    - {mesh: b.stl, rgb: [1, 1, 1], at: 3}\n"
    )
    with pytest.raises(ArmFileError) as error:
        link_meshes(tmp_path)
    assert [line.split(": ")[0] for line in str(error.value).splitlines()] == [f"{path}:3", f"{path}:4"]


@pytest.mark.runs("arms/README.md yaml 1")
def test_the_example_in_the_documentation_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / PLACES
    path.parent.mkdir()
    path.write_text(code("arms/README.md", "yaml"))
    (mesh,) = link_meshes(tmp_path)
    assert mesh in [replace(one, path=mesh.path) for one in link_meshes(find_arm("so101").folder)]


def test_an_arm_without_meshes_has_none(tmp_path: Path) -> None:
    assert link_meshes(tmp_path) == []


@pytest.mark.parametrize("name", OWNED)
def test_every_link_of_a_real_arm_has_a_mesh(name: str) -> None:
    arm = find_arm(name)
    meshes = link_meshes(arm.scene.parent)
    frames = {"camera_link", "camera_optical_frame"}
    assert {mesh.link for mesh in meshes} == set(parse_urdf(arm.urdf.read_text()).links) - frames
    for mesh in meshes:
        vertices, faces = read_stl(mesh.path)
        assert np.ptp(vertices, axis=0).max() < 0.3, "meters, not millimeters"
        assert faces.max() < len(vertices)


@pytest.mark.parametrize("name", OWNED)
def test_the_license_exists_and_each_mesh_is_used(name: str) -> None:
    folder = (ARMS / name / PLACES).parent
    text = (folder / "LICENSE").read_text()
    assert "MIT License" in text or "Apache License" in text
    assert {path.name for path in folder.glob("*.stl")} == {mesh.path.name for mesh in link_meshes(ARMS / name)}


def test_the_wheel_grows_by_less_than_three_megabytes(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "meshes.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in ARMS.glob("*/meshes/*"):
            archive.write(path)
    assert (tmp_path / "meshes.zip").stat().st_size < MOST_BYTES


def test_an_invalid_mesh_name_is_refused(tmp_path: Path) -> None:
    for name in ("a\0b.stl", "x" * 1000):
        with pytest.raises(ArmFileError, match=r"cannot be read: .*: correct the name in links.yaml"):
            read_stl(tmp_path / name)


def test_a_mesh_that_is_too_large_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    with path.open("wb") as file:
        file.truncate(LARGEST_SHAPE_BYTES + 1)
    with pytest.raises(ArmFileError, match=r"part.stl is larger than 20 MB: reduce the number of its triangles"):
        read_stl(path)

"""Scenes of users: their size, their encoding, and invalid numbers that MuJoCo accepts, with or without a warning."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hal.file_size import LARGEST_BYTES, LARGEST_SHAPE_BYTES
from hal.hal_errors import ArmFileError
from servoloop.dashboard.shapes import GRAY, scene_shapes, shapes, thing_shapes
from servoloop.stack.arm_folders import find_arm
from sim_backend.scene.scene_check import require_scene
from sim_backend.scene.scene_file import scene_model, scene_spec
from sim_backend.scene.world import World

SCENE = find_arm("so101").scene
READERS = (scene_model, scene_spec, World, lambda path: require_scene(path, []), lambda path: list(scene_shapes(path)))


def edited(folder: Path, old: str, new: str) -> Path:
    text = SCENE.read_text()
    assert old in text
    path = folder / "scene.xml"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('pos="', 'pos="nan 0 0" was="', 'pos must consist of numbers up to 1e+10, not "nan 0 0"'),
        ('size="', 'size="1e30 1 1" was="', "size must consist of numbers up to 1e+10"),
        ("<worldbody>", '<worldbody><replicate count="2000000"><geom size="1"/></replicate>', "more than 10000 copies"),
        ("<worldbody>", "<worldbody", "is not well-formed XML: not well-formed (invalid token): line "),
        ("<worldbody>", "<worldbody><!-- " + "x" * 2_000_000 + " -->", "scene.xml is larger than 2 MB: shorten it"),
        ("<worldbody>", '<worldbody><geom size="x"/>', "scene.xml: MuJoCo cannot read the scene: "),
    ],
)
def test_an_invalid_scene_is_refused_by_every_reader(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = edited(tmp_path, old, new)
    for read in READERS:
        with pytest.raises(ArmFileError) as error:
            read(path)
        assert says in str(error.value) and str(path) in str(error.value)


def test_a_scene_in_another_encoding_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_bytes(SCENE.read_text().replace("<worldbody>", "<worldbody><!-- Länge -->").encode("latin-1"))
    with pytest.raises(ArmFileError, match=r"scene.xml is not text in UTF-8 \(line \d+, byte 0xe4\)"):
        World(path)


def test_bodies_without_names_are_shown(tmp_path: Path) -> None:
    path = edited(tmp_path, "<worldbody>", '<worldbody><body><geom type="box" size="1 1 1"/></body>')
    assert [shape.link for shape in thing_shapes(path)] == ["cube"]
    assert len(list(scene_shapes(path))) == len(list(scene_shapes(SCENE)))


def test_a_color_without_numbers_is_the_default() -> None:
    visual = '<visual><geometry><box size="1 1 1"/></geometry><material name="x"><color/></material></visual>'
    (shape,), _ = shapes(f'<robot name="a"><link name="b">{visual}</link></robot>')
    assert shape.rgb == GRAY


def scene_with(folder: Path, text: str) -> Path:
    path = folder / "scene.xml"
    path.write_text(f"<mujoco>{text}<worldbody><geom size='1'/></worldbody></mujoco>")
    return path


LARGE = "<mujoco><!-- " + "x" * LARGEST_BYTES + " --></mujoco>"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('<include file="other.xml"/>', "other.xml"),
        ('<asset><model name="m" file="parts/other.xml"/></asset>', "parts/other.xml"),
        ('<include file="between.xml"/>', "other.xml"),
    ],
)
def test_a_scene_that_names_a_too_large_scene_is_refused(tmp_path: Path, text: str, name: str) -> None:
    path = scene_with(tmp_path, text)
    (tmp_path / "between.xml").write_text('<mujoco>\n<include file="other.xml"/></mujoco>')
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(LARGE)
    with pytest.raises(ArmFileError, match=rf"^{path}, line 1: .*{name} is larger than 2 MB: shorten it"):
        scene_model(path)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('<asset><mesh file="a.stl"/></asset>', "a.stl"),
        ('<compiler meshdir="parts"/><asset><mesh file="a.stl"/></asset>', "parts/a.stl"),
        ('<compiler strippath="true"/><asset><mesh file="far/away/a.stl"/></asset>', "a.stl"),
        ('<asset><texture type="cube" fileup="a.png"/></asset>', "a.png"),
    ],
)
def test_a_large_mesh_or_picture_of_a_scene_is_refused(tmp_path: Path, text: str, name: str) -> None:
    path = scene_with(tmp_path, text)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    with (tmp_path / name).open("wb") as file:
        file.truncate(LARGEST_SHAPE_BYTES + 1)
    with pytest.raises(ArmFileError, match=rf"^{path}, line 1: .*{name} is larger than 20 MB: reduce the number of"):
        scene_model(path)


def test_numbers_of_an_included_scene_are_checked(tmp_path: Path) -> None:
    path = scene_with(tmp_path, '<include file="other.xml"/>')
    (tmp_path / "other.xml").write_text('<mujoco>\n<worldbody><geom size="nan"/></worldbody></mujoco>')
    with pytest.raises(
        ArmFileError, match=r'other.xml, line 2: geom size must consist of numbers up to 1e\+10, not "nan'
    ):
        scene_model(path)


def test_a_pipe_that_a_scene_includes_is_refused(tmp_path: Path) -> None:
    path = scene_with(tmp_path, '<include file="pipe.xml"/>')
    os.mkfifo(tmp_path / "pipe.xml")
    with pytest.raises(ArmFileError, match=r"pipe.xml is not a regular file: choose another file"):
        scene_model(path)


def test_impossible_file_names_are_reported_by_mujoco(tmp_path: Path) -> None:
    path = scene_with(tmp_path, f'<include file="{"x" * 1000}"/>')
    with pytest.raises(ArmFileError, match="MuJoCo cannot read the scene"):
        scene_model(path)


def test_scenes_that_include_each_other_end(tmp_path: Path) -> None:
    path = scene_with(tmp_path, '<include file="scene.xml"/>')
    with pytest.raises(ArmFileError, match="MuJoCo cannot read the scene"):
        scene_model(path)


def test_a_scene_of_several_files_is_read(tmp_path: Path) -> None:
    path = scene_with(tmp_path, '<include file="parts/other.xml"/>')
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "other.xml").write_text('<mujoco><worldbody><body name="b"/></worldbody></mujoco>')
    assert scene_model(path).body("b").id == 1


@pytest.mark.parametrize("reader", [scene_model, scene_spec])
def test_a_path_that_is_not_utf8_is_refused(tmp_path: Path, reader: Callable[[Path], object]) -> None:
    folder = tmp_path / os.fsdecode(b"arm\xfc")
    folder.mkdir()
    path = Path(shutil.copy(SCENE, folder))
    with pytest.raises(ArmFileError, match="MuJoCo cannot open this path, because it is not valid UTF-8: rename"):
        reader(path)

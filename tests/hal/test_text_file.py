"""Tests of the encodings and size limits of user files."""

import codecs
import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import pytest

from commissioning.commissioning_errors import CalibrationError
from commissioning.lerobot import read_lerobot
from controller.manager.parameter_file import read_parameter_file
from controller.manager_errors import ControllersFileError
from hal.file_size import LARGEST_BYTES
from hal.hal_errors import DescriptionError, HalError, RobotFileError
from hal.robot_description.description import parse_urdf
from hal.robot_description.link_meshes import link_meshes
from hal.robot_description.xacro_file import expand_xacro
from hal.robot_file.robot_file import load_robot_file
from hal.text_file import exists, read_text, read_xml
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import read_description
from servoloop.stack.shipped_files import URDF

DECLARED = '<?xml version="1.0" encoding="{}"?>\n<robot name="{}"/>'


def urdf_with(declaration: str, name: str) -> str:
    """Return the URDF of the robot arm with a comment in another language."""
    _, _, rest = URDF.read_text().partition("<robot")
    return f"{declaration}<!-- {name} -->\n<robot{rest}"


@pytest.mark.parametrize(
    ("declaration", "encoding"),
    [
        ('<?xml version="1.0" encoding="ISO-8859-1"?>', "latin-1"),
        ("<?xml version='1.0' encoding='windows-1252' standalone='yes'?>", "cp1252"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16-le"),
        ('<?xml version="1.0"?>', "utf-16"),
        ('<?xml version="1.0" encoding="utf-8"?>', "utf-8-sig"),
        ("", "utf-8-sig"),
        ("", "utf-8"),
        ("", "utf-32"),
    ],
)
def test_a_urdf_is_read_in_its_encoding(tmp_path: Path, declaration: str, encoding: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(urdf_with(declaration, "Länge").encode(encoding))
    description = read_description(path)
    assert "Länge" in description.xml
    assert parse_urdf(description.xml).joints.keys() == description.joints.keys()
    assert not any(word in description.xml.partition("?>")[0] for word in ("8859", "1252", "UTF-16"))


def test_a_urdf_in_a_chinese_encoding(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(DECLARED.format("GBK", "机械臂").encode("gbk"))
    assert read_xml(path, DescriptionError) == DECLARED.format("UTF-8", "机械臂")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (urdf_with("", "Länge").encode("latin-1"), "arm.urdf is not text in UTF-8 (line 1, byte 0xe4): save"),
        ("<robot>\n<!-- 机械臂 --></robot>".encode("gbk"), "(line 2, byte 0xbb): save the file as UTF-8, or declare"),
        (DECLARED.format("klingon", "a").encode(), "arm.urdf, line 1: the encoding klingon is unknown: save"),
        (DECLARED.format("rot13", "a").encode(), "line 1: rot-13 is not a text encoding: save"),
        (DECLARED.format("undefined", "a").encode(), "save the file as UTF-8"),
        (DECLARED.format("UTF-16", "a").encode(), "the file declares UTF-16 but has a different encoding: save"),
        (DECLARED.format("ascii", "ä").encode(), "is not text in ASCII (line 2, byte 0xc3)"),
        (codecs.BOM_UTF16_LE + b"<\x00r", "arm.urdf"),
        (b"\x00\xff" * 9, "arm.urdf"),
    ],
)
def test_a_urdf_in_an_undeclared_encoding_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(data)
    with pytest.raises(DescriptionError) as error:
        read_description(path)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
def test_yaml_and_json_are_read_in_the_encoding_of_their_first_bytes(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "file"
    path.write_bytes("arm:\r\n  ros__parameters: {text: Länge}".encode(encoding))
    assert read_parameter_file(path, ControllersFileError)[1]["arm"]["ros__parameters"] == {"text": "Länge"}
    path.write_bytes('{"größe": {"id": 1}}'.encode(encoding))
    with pytest.raises(CalibrationError, match=r"größe\.drive_mode: is missing"):
        read_lerobot(path)


def test_yaml_and_json_in_latin_1_are_refused_with_the_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes("joints: {}\n# Länge".encode("latin-1"))
    message = r"robot\.yaml is not text in UTF-8 \(line 2, byte 0xe4\): save the file as UTF-8$"
    with pytest.raises(RobotFileError, match=message):
        load_robot_file(path)
    with pytest.raises(CalibrationError, match=message):
        read_lerobot(path)


def test_an_endless_file_is_refused() -> None:
    with pytest.raises(RobotFileError, match=rf"/dev/zero is larger than {LARGEST_BYTES / 1e6:g} MB: shorten it"):
        read_text(Path("/dev/zero"), RobotFileError)


@pytest.mark.parametrize(
    ("name", "found"),
    [("file", True), (".", True), ("absent", False), ("file/under", False), ("n" * 256, False), ("\0", False)],
)
def test_whether_a_file_exists(tmp_path: Path, name: str, found: bool) -> None:
    (tmp_path / "file").touch()
    assert exists(tmp_path / name, RobotFileError) is found


def refuse_access(path: Path) -> NoReturn:
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


@pytest.mark.parametrize("read", [load_robot_file, link_meshes, lambda path: expand_xacro(path, {})])
def test_a_folder_without_permission_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Callable[[Path], object]
) -> None:
    monkeypatch.setattr(Path, "stat", refuse_access)
    with pytest.raises(HalError, match=f"^cannot access {tmp_path}/.*: Permission denied$"):
        read(tmp_path / "arm")


def test_a_link_to_itself_is_reported(tmp_path: Path) -> None:
    link = tmp_path / "servo_models.yaml"
    link.symlink_to(link)
    with pytest.raises(RobotFileError, match=f"^cannot access {link}: Too many levels of symbolic links$"):
        load_robot_file(tmp_path / "robot.yaml")


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(['*' + former] * 9)}]\n" for former, name in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "a: &a {x: 1, y: 2}\n" + "".join(
    f"{name}: &{name} {{<<: [{', '.join(['*' + former] * 9)}]}}\n"
    for former, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "values after its aliases"),
        (MERGES, "values after its aliases"),
        ("joints: [" + ", ".join(["1.25"] * 200_000) + "]", "has more than 150000 values: shorten it"),
        ("joints: [" + "1.25, " * 900_000 + "]", "is larger than 2 MB"),
        ("".join(f"k{number}: 1\n" for number in range(20_000)), "and 19951 more errors"),
        ("".join(f"k{number % 9}: 1\n" for number in range(20_000)), "duplicate key"),
        ("a: " + "[" * 90_000, "contains itself or is nested too deeply"),
        ("a: &a [*a]", "contains itself or is nested too deeply"),
        ("a: &a0 x\n" + "".join(f"k{n}: &a{n + 1} [*a{n}]\n" for n in range(3000)), "nested too deeply"),
        ("a: " + "1" * 5000, "(line 1): correct this line"),
        ("a: !!bool maybe", "(line 1): correct this line"),
        ("a: !!timestamp soon", "(line 1): correct this line"),
        ("a: !!int ''", "(line 1): correct this line"),
        ("a: !!python/object:os.system x", "is not YAML: could not determine a constructor"),
        ("a: \x00", "is not YAML: "),
    ],
)
def test_oversized_files_are_refused_quickly(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(RobotFileError) as error:
        load_robot_file(path)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) <= 51


NODES = "controller_manager:\n  ros__parameters: {update_rate: 20"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (NODES + "".join(f", k{n}: {n}" for n in range(20_000)) + "}", "controller_manager has more than 2000 values"),
        (NODES + "".join(f", c{n}: {{type: x}}" for n in range(20_000)) + "}", "has more than 2000 values"),
        (NODES + ", l: [" + "x, " * 20_000 + "x]}", "has more than 2000 values: shorten its lists"),
        (
            NODES + "}\n" + "".join(f"n{n}: {{ros__parameters: {{a: 1}}}}\n" for n in range(9000)),
            "more than 300 nodes",
        ),
        (NODES + "}\n" + "".join(f"/**/n{n}: {{ros__parameters: {{a: 1}}}}\n" for n in range(9000)), "300 nodes"),
        (NODES + "".join(f", c{n}: {{type: x}}" for n in range(900)) + "}", "more than 300 controllers"),
    ],
)
def test_oversized_controllers_files_are_refused_quickly(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(text)
    with pytest.raises(ControllersFileError) as error:
        read_arm_files(find_arm(), controllers=path)
    assert message in str(error.value) and f"{path}:" in str(error.value)


def test_json_with_many_keys_is_refused_quickly(tmp_path: Path) -> None:
    path = tmp_path / "lerobot.json"
    for text, message in (
        ("{" + ",".join(['"a": 1'] * 200_000) + "}", "duplicate key: a"),
        ("{" + ",".join(f'"a{number}": 1' for number in range(100_000)) + "}", "and 99950 more errors"),
    ):
        path.write_text(text)
        with pytest.raises(CalibrationError, match=message):
            read_lerobot(path)

"""A robot description in xacro is expanded, or refused with its file and line."""

from pathlib import Path

import pytest

pytest.importorskip("xacro")

from hal.hal_errors import DescriptionError
from hal.robot_description.description import parse_urdf
from hal.robot_description.xacro_file import expand_xacro

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
ARM = f"""{HEAD}<xacro:arg name="prefix" default=""/>
<xacro:arg name="reach" default="1"/>
<xacro:include filename="arm.xacro"/>
<link name="base"/>
<xacro:arm prefix="$(arg prefix)" reach="$(arg reach)"/>
</robot>
"""
MACRO = f"""{HEAD}<xacro:macro name="arm" params="prefix reach">
<link name="${{prefix}}hand"/>
<joint name="${{prefix}}joint" type="revolute">
<parent link="base"/><child link="${{prefix}}hand"/>
<limit lower="${{-reach}}" upper="${{reach * 2}}" velocity="1" effort="1"/>
</joint>
<ros2_control name="r" type="system"><hardware><plugin>p</plugin></hardware>
<joint name="${{prefix}}joint"><command_interface name="position"/></joint>
</ros2_control>
</xacro:macro>
</robot>
"""


def written(folder: Path, text: str) -> Path:
    """Write the files; ``text`` is the content of the first one."""
    (folder / "arm.xacro").write_text(MACRO)
    path = folder / "robot.urdf.xacro"
    path.write_text(text)
    return path


def test_macros_includes_and_arguments_are_expanded(tmp_path: Path) -> None:
    urdf = expand_xacro(written(tmp_path, ARM), {"prefix": "left_", "reach": "0.5"})
    joint = parse_urdf(urdf).joints["left_joint"]
    assert (joint.lower, joint.upper) == (-0.5, 1.0)
    assert parse_urdf(expand_xacro(tmp_path / "robot.urdf.xacro", {})).joints["joint"].upper == 2.0


@pytest.mark.parametrize(
    ("changed", "arguments", "reason"),
    [
        (("$(arg reach)", "$(arg length)"), {}, "robot.urdf.xacro, line 6: .*length"),
        (("xacro:arm prefix", "xacro:leg prefix"), {}, "robot.urdf.xacro, line 6: unknown macro name: xacro:leg"),
        (
            ('"$(arg reach)"', '"${2 * size}"'),
            {},
            "robot.urdf.xacro, line 6: name 'size' is not defined in \\$\\{2 \\* size\\}: correct it",
        ),
        (("arm.xacro", "leg.xacro"), {}, "leg.xacro"),
        (("<link name", "<link <name"), {}, "robot.urdf.xacro, line 5: not well-formed"),
        (("arm.xacro", "$(find my_arm)/arm.xacro"), {}, r"\$\(find PACKAGE\) finds a package only in a ROS workspace"),
        (("", ""), {"prefx": "a"}, r"has no xacro argument prefx \(it declares prefix, reach\): correct --xacro-arg"),
    ],
    ids=["argument", "macro", "property", "include", "XML", "find", "undeclared"],
)
def test_a_mistake_is_reported_in_one_sentence_with_its_place(
    changed: tuple[str, str], arguments: dict[str, str], reason: str, tmp_path: Path
) -> None:
    path = written(tmp_path, ARM.replace(*changed, 1) if changed[0] else ARM)
    with pytest.raises(DescriptionError, match=reason) as caught:
        expand_xacro(path, arguments)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"cannot read the URDF .*absent.xacro"):
        expand_xacro(tmp_path / "absent.xacro", {})

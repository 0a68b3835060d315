"""Links, shapes and tool path of the drawn arm."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from hal.file_size import LARGEST_SHAPE_BYTES, REDUCE
from hal.robot_description.description import parse_urdf
from hal.types import FloatArray
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.page import known_arm
from servoloop.dashboard.scene import LOAD, PLAIN, TEMPERATURE, color_of, shares
from servoloop.dashboard.shapes import GRAY, DrawnShape, arm_shapes, scene_shapes, shapes
from servoloop.stack.arm_folders import arms, find_arm
from sim_backend.arm_names import arm_prefixes
from sim_backend.scene.scene_file import scene_model
from tests.stack.rig import PICK, READY

XML = find_arm().urdf.read_text()
MEASURED = (*(f"joint{number}" for number in range(1, 7)), "hand_right_joint")
ARM = MEASURED[:6]


@pytest.fixture
def model() -> DrawnArm:
    return DrawnArm(parse_urdf(XML).joints, MEASURED)


@pytest.mark.parametrize("pose", [(0.0,) * 7, (*READY, 0.01), (*PICK, 0.05)])
def test_the_links_are_at_their_places_in_mujoco(model: DrawnArm, pose: tuple[float, ...]) -> None:
    scene = mujoco.MjModel.from_xml_path(str(find_arm().scene))
    data = mujoco.MjData(scene)
    for joint, position in zip((*MEASURED, "hand_left_joint"), (*pose, pose[-1]), strict=True):
        data.joint(joint).qpos[0] = position
    mujoco.mj_kinematics(scene, data)
    places = {scene.body(body).name for body in range(scene.nbody)}
    assert set(model.links) - places == {"camera_link", "camera_optical_frame"}, "a camera is no body"
    for link in places & set(model.links):
        np.testing.assert_allclose(model.place(link, np.array(pose)), data.body(link).xpos, atol=1e-9)


def test_a_link_is_below_its_parents_in_the_tree_and_knows_its_joint(model: DrawnArm) -> None:
    assert model.branch("link2") == "/base_link/link1/link2"
    joints = [model.joint_of(link) for link in ("base_link", "link2", "hand_left_link")]
    assert joints == [None, "joint2", "hand_right_joint"], "the left finger follows the right one"


def test_a_link_whose_mimic_joint_follows_a_joint_without_measurement_has_no_joint() -> None:
    arm_only = DrawnArm(parse_urdf(XML).joints, ARM)
    assert [arm_only.joint_of(link) for link in ("hand_right_link", "hand_left_link", "link2")] == [
        None,
        None,
        "joint2",
    ]


def test_the_path_of_the_tool_starts_at_the_initial_pose_and_passes_all_points(model: DrawnArm) -> None:
    start, points = np.array([*READY, 0.0]), np.array([PICK, [0.4, *PICK[1:]]])
    path = model.path(ARM, points, start)
    places = [model.place("gripper_base_link", np.array([*pose, 0.0])) for pose in (READY, *points)]
    np.testing.assert_allclose(path[[0, len(path) // 2, -1]], places)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.05, "it is a line, not two jumps"
    np.testing.assert_allclose(model.path(ARM, points, None)[[0, -1]], places[1:])


def test_a_goal_for_some_joints_does_not_move_the_others(model: DrawnArm) -> None:
    path = model.path(("joint3", "joint1"), np.array([[-0.5, 0.3]]), np.array([*READY, 0.0]))
    expected = np.array([0.3, READY[1], -0.5, *READY[3:], 0.0])
    np.testing.assert_allclose(path[-1], model.place("link3", expected))


@pytest.mark.parametrize(("name", "reach_m"), [("robot_arm", 0.748), ("so101", 0.489), ("koch", 0.347)])
def test_the_reach_of_each_arm_is_known(name: str, reach_m: float) -> None:
    joints = parse_urdf(find_arm(name).urdf.read_text()).joints
    assert DrawnArm(joints, ()).reach_m == pytest.approx(reach_m, abs=1e-3)


def test_the_tool_is_the_last_link_fixed_to_the_chain() -> None:
    so101 = parse_urdf(find_arm("so101").urdf.read_text())
    joints = [name for name, joint in so101.joints.items() if joint.kind == "revolute"]
    model = DrawnArm(so101.joints, joints)
    tool = model.tool_link(joints[:-1])
    assert model.joint_of(tool) == joints[-2] and not any(
        joint.parent == tool and joint.kind == "fixed" for joint in so101.joints.values()
    )


@pytest.mark.parametrize("arm", arms(), ids=lambda arm: str(arm.name))
def test_every_included_arm_has_shapes_and_a_scene(arm: object) -> None:
    found = find_arm(arm.name)  # type: ignore[attr-defined]
    visuals, missing = shapes(found.urdf.read_text(), found.urdf.parent)
    assert visuals and not missing
    prefixes = arm_prefixes(scene_model(found.scene))
    things = {f"{prefix}{part}" for prefix in prefixes for part in ("bin_A", "bin_B", "bin_C", "stand")}
    assert {shape.link for shape in scene_shapes(found.scene)} == things
    assert known_arm(found.urdf.read_text())


@pytest.mark.parametrize("name", ["so101", "so101_12v", "so101_leader", "so100", "koch", "bimanual_so101"])
def test_arms_with_meshes_are_drawn_with_their_real_shapes(name: str) -> None:
    arm = find_arm(name)
    boxes, _ = shapes(arm.urdf.read_text(), arm.urdf.parent)
    drawn, _ = arm_shapes(arm.urdf.read_text(), arm.urdf.parent, arm.scene.parent)
    assert {shape.link for shape in drawn} == {shape.link for shape in boxes}
    assert not any(shape.flat for shape in drawn) and sum(len(shape.faces) for shape in drawn) > 10_000
    for link in {shape.link for shape in boxes}:
        assert np.abs(bounds(drawn, link) - bounds(boxes, link)).max() < 0.06, "each mesh is where its boxes are"


def bounds(shown: Sequence[DrawnShape], link: str) -> FloatArray:
    """Return the lowest and highest corners (2, 3) of a link's shapes in its frame, in meters."""
    turned = [
        trimesh.transformations.quaternion_matrix(np.roll(shape.quaternion, 1))[:3, :3] @ shape.vertices.T
        for shape in shown
        if shape.link == link
    ]
    places = [np.array(shape.position_m)[:, None] for shape in shown if shape.link == link]
    corners = np.concatenate([points + place for points, place in zip(turned, places, strict=True)], axis=1)
    return np.array([corners.min(axis=1), corners.max(axis=1)])


def test_an_arm_without_meshes_keeps_the_shapes_of_its_description() -> None:
    visuals, drawn = shapes(XML), arm_shapes(XML, find_arm().urdf.parent, find_arm().scene.parent)
    assert list(map(repr, drawn[0])) == list(map(repr, visuals[0]))


def test_meshes_of_unknown_links_are_not_drawn() -> None:
    so101 = find_arm("so101")
    drawn, _ = arm_shapes(XML, find_arm().urdf.parent, so101.scene.parent)
    assert {shape.link for shape in drawn} <= set(parse_urdf(XML).links)


def test_shapes_have_the_size_position_and_color_of_the_description() -> None:
    first, second, *_ = shapes(XML)[0]
    assert first.link == "base_link" and first.rgb == (41, 43, 51) and first.position_m == (0.0, 0.0, 0.01)
    np.testing.assert_allclose(np.ptp(first.vertices, axis=0), (0.12, 0.12, 0.02), atol=1e-6)
    assert not first.flat and second.rgb == (230, 230, 224)


def test_meshes_are_found_next_to_the_urdf_and_missing_ones_are_reported(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box(extents=(1.0, 2.0, 3.0)).export(tmp_path / "meshes" / "part.stl")
    visual = '<visual><geometry><mesh filename="{}" scale="0.1 0.1 0.1"/></geometry></visual>'
    names = ("meshes/part.stl", "package://meshes/part.stl", f"file://{tmp_path}/meshes/part.stl", "meshes/none.stl")
    links = "".join(f"<link name='l'>{visual.format(name)}</link>" for name in names)
    found, missing = shapes(f"<robot name='r'>{links}</robot>", tmp_path)
    assert missing == ["meshes/none.stl"] and len(found) == 3 and {shape.rgb for shape in found} == {GRAY}
    for shape in found:
        np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), (0.1, 0.2, 0.3))


def drawn(folder: Path, visual: str) -> tuple[list[DrawnShape], list[str]]:
    """Return the shapes and the names of the missing shapes of a robot with this visual."""
    return shapes(f"<robot name='r'><link name='l'><visual>{visual}</visual></link></robot>", folder)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("arm.dae", "<COLLADA/>"),
        ("arm.zip", "not a zip file"),
        ("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("empty.stl", ""),
        ("empty.obj", ""),
    ],
)
def test_any_mesh_that_cannot_be_read_is_reported(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    assert drawn(tmp_path, f'<geometry><mesh filename="{name}"/></geometry>') == ([], [name])


@pytest.mark.parametrize(
    ("visual", "missing"),
    [
        ('<geometry><box size="1 1 1"/></geometry><origin xyz="0 0"/>', ["box"]),
        ('<geometry><box size="nan 1 1"/></geometry>', ["box"]),
        ('<geometry><capsule radius="0.1" length="1"/></geometry>', ["capsule"]),
    ],
)
def test_a_shape_with_invalid_numbers_is_reported(tmp_path: Path, visual: str, missing: list[str]) -> None:
    assert drawn(tmp_path, visual) == ([], missing)


@pytest.mark.parametrize("rgba", ["red", "1 0", "nan 0 0 1", "255 0 0 1"])
def test_a_shape_with_an_invalid_color_is_gray(tmp_path: Path, rgba: str) -> None:
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    ((shape,), missing) = drawn(tmp_path, f'<geometry><box size="1 1 1"/></geometry>{material}')
    assert (shape.rgb, missing) == (GRAY, [])


def test_a_mesh_that_is_too_large_is_reported_and_not_drawn(tmp_path: Path) -> None:
    with (tmp_path / "part.obj").open("wb") as file:
        file.truncate(LARGEST_SHAPE_BYTES + 1)
    visual = '<visual><geometry><mesh filename="part.obj"/></geometry></visual>'
    found, missing = shapes(f"<robot name='r'><link name='l'>{visual}</link></robot>", tmp_path)
    assert (found, missing) == ([], [f"{tmp_path / 'part.obj'} is larger than 20 MB: {REDUCE}"])


def test_joints_are_colored_from_blue_to_red_unless_their_value_is_unknown() -> None:
    temperature, effort, limit = np.array([25.0, 70.0, np.nan]), np.array([0.0, -1.5, 9.0]), np.array([3.0, 3.0, 3.0])
    assert shares(TEMPERATURE, temperature, effort, limit)[:2].tolist() == [0.0, 1.0]
    assert shares(LOAD, temperature, effort, limit).tolist() == [0.0, 0.5, 3.0]
    assert np.isnan(shares(PLAIN, temperature, effort, limit)).all()
    assert color_of(0.0) == (62, 121, 214) and color_of(1.0) == color_of(3.0) == (214, 48, 40)
    assert color_of(float("nan")) is None

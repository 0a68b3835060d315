"""Tests of messages that change the planning scene."""

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose
from moveit_msgs.msg import (
    AllowedCollisionEntry,
    AllowedCollisionMatrix,
    AttachedCollisionObject,
    CollisionObject,
    MoveItErrorCodes,
    PlanningScene,
    RobotState,
)
from shape_msgs.msg import Mesh, MeshTriangle, Plane, SolidPrimitive
from std_msgs.msg import Header

from nodes.planning.conversion.frames import Frames
from nodes.planning.edits import WorldEdit
from nodes.planning.request_errors import REFUSALS, error_code
from nodes.planning.world import PlanningWorld, first_world
from planning.arm_model import pair
from planning.scene import Box
from tests.nodes.planning.robots import READY, at, box, robot_arm

HALF = np.sqrt(0.5)


def edit(world: PlanningWorld | None = None) -> WorldEdit:
    robot = robot_arm()
    return WorldEdit(robot, world or first_world(robot), lambda: READY)


def test_the_world_at_the_start_has_the_fixed_objects_of_the_bench() -> None:
    world = first_world(robot_arm())
    assert {"table", "stand"} <= world.items.keys()
    assert "cube" not in world.names(robot_arm())
    assert robot_arm().validity(READY, world.scene).is_valid


def test_an_object_keeps_its_shape_and_pose_and_can_be_moved_and_removed() -> None:
    change = edit()
    change.apply_object(box("crate", at(0.3, 0.1, 0.2)))
    assert change.world.scene.objects["crate"].pose.position_m.tolist() == [0.3, 0.1, 0.2]
    move = CollisionObject(header=Header(frame_id="base_link"), id="crate", operation=CollisionObject.MOVE)
    move.pose = at(0.0, 0.5, 0.2)
    change.apply_object(move)
    assert change.world.scene.objects["crate"].shapes[0][0] == Box(0.05, 0.05, 0.05)
    assert change.world.items["crate"].pose.position.y == 0.5
    change.apply_object(CollisionObject(id="crate", operation=CollisionObject.REMOVE))
    assert "crate" not in change.world.items


def test_a_move_keeps_the_shapes_and_moves_them_within_the_object() -> None:
    change = edit()
    change.apply_object(box("crate", at(0.3, 0.1, 0.2)))
    move = box("crate", at(0.3, 0.1, 0.3), side_m=0.5)
    move.operation, move.primitive_poses = CollisionObject.MOVE, [at(0.0, 0.0, 0.1)]
    change.apply_object(move)
    crate = change.world.scene.objects["crate"]
    ((shape, own),) = crate.shapes
    assert shape == Box(0.05, 0.05, 0.05)
    assert (crate.pose @ own).position_m.tolist() == pytest.approx([0.3, 0.1, 0.4])
    move.primitive_poses = [Pose(), Pose()]
    with pytest.raises(REFUSALS, match='MOVE of object "crate" has 2 poses of shapes, but the object has 1 shapes'):
        change.apply_object(move)


def test_shapes_are_appended_to_an_attached_object() -> None:
    change = edit()
    held = AttachedCollisionObject(link_name="link5", object=box("crate", at(0.0, 0.0, 0.1), frame="link5"))
    held.touch_links = ["link4"]
    change.apply_attached(held)
    more = AttachedCollisionObject(link_name="link5", object=box("crate", Pose(), 0.02, frame="link5"))
    more.object.operation, more.object.primitive_poses = CollisionObject.APPEND, [at(0.0, 0.0, 0.05)]
    more.touch_links = ["gripper_base_link"]
    change.apply_attached(more)
    crate = change.world.scene.attached["crate"]
    assert [shape for shape, _ in crate.item.shapes] == [Box(0.05, 0.05, 0.05), Box(0.02, 0.02, 0.02)]
    assert crate.item.pose.position_m.tolist() == pytest.approx([0.0, 0.0, 0.1])
    assert set(crate.touch_links) == {"link4", "gripper_base_link"}


def test_an_object_is_detached_only_from_its_link() -> None:
    change = edit()
    change.apply_attached(AttachedCollisionObject(link_name="link5", object=box("crate", Pose(), frame="link5")))
    gone = CollisionObject(id="crate", operation=CollisionObject.REMOVE)
    with pytest.raises(REFUSALS, match='"crate" is attached to link5, not to link2: omit the link'):
        change.apply_attached(AttachedCollisionObject(link_name="link2", object=gone))
    change.apply_attached(AttachedCollisionObject(object=gone))
    assert not change.world.scene.attached


def test_the_only_shape_of_an_object_without_a_pose_gives_its_pose() -> None:
    item = box("crate", Pose())
    item.primitive_poses = [at(0.3, 0.1, 0.2)]
    change = edit()
    change.apply_object(item)
    assert change.world.scene.objects["crate"].pose.position_m.tolist() == [0.3, 0.1, 0.2]


def test_shape_without_a_pose_is_at_the_pose_of_its_object() -> None:
    item = box("crate", at(0.3, 0.1, 0.2))
    item.primitive_poses = []
    change = edit()
    change.apply_object(item)
    crate = change.world.scene.objects["crate"]
    assert (crate.pose @ crate.shapes[0][1]).position_m.tolist() == [0.3, 0.1, 0.2]


def test_poses_are_in_the_frame_of_the_header() -> None:
    change = edit()
    change.apply_object(box("crate", at(0.3, 0.0, 0.2, (0.0, 0.0, HALF, HALF))))
    change.apply_object(box("lid", at(0.1, 0.0, 0.0), frame="crate"))
    assert change.world.scene.objects["lid"].pose.position_m == pytest.approx([0.3, 0.1, 0.2])


def test_subframes_are_frames() -> None:
    change = edit()
    item = box("crate", at(0.3, 0.0, 0.2))
    item.subframe_names, item.subframe_poses = ["top"], [at(0.0, 0.0, 0.025)]
    change.apply_object(item)
    frames = Frames(robot_arm(), READY, change.world.scene, change.world.items)
    assert frames.in_base("crate/top").position_m == pytest.approx([0.3, 0.0, 0.225])
    with pytest.raises(REFUSALS, match='there is no frame "crate/side": choose one of base_link'):
        frames.in_base("crate/side")


def test_an_attached_object_moves_with_its_link_and_returns_to_the_world() -> None:
    change = edit()
    change.apply_object(box("crate", at(0.3, 0.0, 0.2)))
    hold = AttachedCollisionObject(link_name="gripper_base_link", touch_links=["hand_left_link"])
    hold.object.id = "crate"
    change.apply_attached(hold)
    held = change.world.scene.attached["crate"]
    assert (held.link, set(held.touch_links)) == ("gripper_base_link", {"hand_left_link"})
    moved = {**READY, "joint1": 0.5}
    assert Frames(robot_arm(), moved, change.world.scene).in_base("crate").position_m[1] > 0.1
    release = AttachedCollisionObject(link_name="gripper_base_link")
    release.object.operation = CollisionObject.REMOVE
    back = WorldEdit(robot_arm(), change.world, lambda: moved)
    back.apply_attached(release)
    place = back.world.scene.objects["crate"].pose.position_m
    assert place == pytest.approx([0.3 * np.cos(0.5), 0.3 * np.sin(0.5), 0.2], abs=1e-6)
    assert not back.world.scene.attached


def test_one_change_detaches_and_removes_or_replaces_an_attached_object() -> None:
    change, gone = edit(), CollisionObject(id="crate", operation=CollisionObject.REMOVE)
    held = AttachedCollisionObject(link_name="link5", object=box("crate", at(0.0, 0.0, 0.1), frame="link5"))
    for objects in ([gone], [box("crate", at(0.3, 0.1, 0.2))]):
        change.apply_attached(held)
        scene = PlanningScene(is_diff=True)
        scene.world.collision_objects = objects
        scene.robot_state.attached_collision_objects = [AttachedCollisionObject(object=gone)]
        change.apply_scene(scene)
        assert not change.world.scene.attached
        assert ("crate" in change.world.items) == (objects != [gone])


@pytest.mark.parametrize("exists", [True, False])
def test_one_change_removes_and_attaches_an_object(exists: bool) -> None:
    change = edit()
    if exists:
        change.apply_object(box("crate", at(0.3, 0.1, 0.2)))
    scene = PlanningScene(is_diff=True)
    scene.world.collision_objects = [CollisionObject(id="crate", operation=CollisionObject.REMOVE)]
    held = AttachedCollisionObject(link_name="link5", object=box("crate", at(0.0, 0.0, 0.1), frame="link5"))
    scene.robot_state.attached_collision_objects = [held]
    change.apply_scene(scene)
    assert set(change.world.scene.attached) == {"crate"}
    assert "crate" not in change.world.scene.objects


def test_a_matrix_allows_and_forbids_pairs_also_by_default() -> None:
    matrix = AllowedCollisionMatrix(
        entry_names=["crate", "link5"],
        entry_values=[AllowedCollisionEntry(enabled=[False, True]), AllowedCollisionEntry(enabled=[True, False])],
        default_entry_names=["lid"],
        default_entry_values=[True],
    )
    change = edit()
    scene = PlanningScene(is_diff=True, allowed_collision_matrix=matrix)
    scene.world.collision_objects = [box("crate", at(0.3, 0.0, 0.2)), box("lid", at(0.3, 0.0, 0.3))]
    change.apply_scene(scene)
    allowed = change.world.scene.allowed
    assert {pair("crate", "link5"), pair("lid", "link5"), pair("crate", "lid")} <= allowed
    assert pair("crate", "link4") not in allowed
    written = change.world.allowed.message(["link4"])
    index = {name: number for number, name in enumerate(written.entry_names)}
    assert written.entry_values[index["crate"]].enabled[index["link5"]]
    assert not written.entry_values[index["crate"]].enabled[index["link4"]]


def test_a_whole_scene_replaces_all_objects() -> None:
    change = edit()
    change.apply_object(box("crate", at(0.3, 0.0, 0.2)))
    scene = PlanningScene(robot_state=RobotState(is_diff=True))
    scene.world.collision_objects = [box("lid", at(0.3, 0.0, 0.3))]
    change.apply_scene(scene)
    assert change.world.items.keys() == {"lid"}
    assert change.world.names(robot_arm()) == [*robot_arm().links, "lid"]


def test_a_plane_is_a_box_below_it() -> None:
    item = CollisionObject(header=Header(frame_id="base_link"), id="floor", pose=at(0.0, 0.0, -0.2))
    item.planes, item.plane_poses = [Plane(coef=[0.0, 0.0, 2.0, 0.2])], [Pose()]
    change = edit()
    change.apply_object(item)
    floor = change.world.scene.objects["floor"]
    top = (floor.pose @ floor.shapes[0][1]).position_m[2] + floor.shapes[0][0].z_m / 2.0
    assert top == pytest.approx(-0.3)


def solid(kind: int, *dimensions: float) -> CollisionObject:
    item = box("thing", at(0.3, 0.0, 0.2))
    item.primitives = [SolidPrimitive(type=kind, dimensions=list(dimensions))]
    return item


def mesh(triangles: list[MeshTriangle]) -> CollisionObject:
    item = CollisionObject(header=Header(frame_id="base_link"), id="thing", mesh_poses=[at(0.3, 0.0, 0.2)])
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    item.meshes = [Mesh(triangles=triangles, vertices=[Point(x=x, y=y, z=z) for x, y, z in points])]
    return item


BAD = [
    (box("", at(0.3, 0.0, 0.2)), "INVALID_OBJECT_NAME", "an object has no id"),
    (box("link3", at(0.3, 0.0, 0.2)), "INVALID_OBJECT_NAME", '"link3" is a link of the robot'),
    (box("thing", at(0.3, 0.0, 0.2), 0.0), "INVALID_OBJECT_NAME", 'box of object "thing" has size 0 x 0 x 0 m'),
    (box("thing", at(0.3, 0.0, 0.2), frame="nowhere"), "FRAME_TRANSFORM_FAILURE", 'there is no frame "nowhere"'),
    (box("thing", at(0.3, 0.0, np.nan)), "INVALID_OBJECT_NAME", "must be finite"),
    (box("thing", at(0.3, 0.0, 0.2, (0.0, 0.0, 0.0, 2.0))), "INVALID_OBJECT_NAME", "has length 2"),
    (box("thing", at(0.3, 0.0, 0.2, (0.0, 0.0, 0.0, 0.0))), "INVALID_OBJECT_NAME", "has length 0"),
    (solid(SolidPrimitive.SPHERE, 0.1, 0.1), "INVALID_OBJECT_NAME", "has 2 dimensions: send 1"),
    (solid(9, 0.1), "INVALID_OBJECT_NAME", "type 9: use box, sphere"),
    (mesh([]), "INVALID_OBJECT_NAME", 'mesh of object "thing" has no triangles'),
    (mesh([MeshTriangle(vertex_indices=[0, 1, 7])]), "INVALID_OBJECT_NAME", "has no vertex 7"),
    (mesh([MeshTriangle(vertex_indices=[0, 1, 2])]), "INVALID_OBJECT_NAME", 'mesh of object "thing"'),
    (CollisionObject(id="gone", operation=CollisionObject.REMOVE), "INVALID_OBJECT_NAME", 'there is no object "gone"'),
    (CollisionObject(id="gone", operation=CollisionObject.MOVE), "INVALID_OBJECT_NAME", 'no object "gone" to move'),
]


@pytest.mark.parametrize(("message", "code", "text"), BAD)
def test_invalid_objects_are_refused(message: CollisionObject, code: str, text: str) -> None:
    change = edit()
    with pytest.raises(REFUSALS, match=text) as caught:
        change.apply_object(message)
    assert error_code(caught.value).val == getattr(MoveItErrorCodes, code)


def test_a_scene_for_another_robot_is_refused() -> None:
    with pytest.raises(REFUSALS, match="the scene is for the robot panda, not for robot_arm"):
        edit().apply_scene(PlanningScene(robot_model_name="panda", is_diff=True))

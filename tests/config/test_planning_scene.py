"""Tests that planning_scene.yaml contains the simulated world, and that the padded arm can reach its working poses."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import pytest

from hal.hal_errors import ArmFileError
from servoloop.moveit.plannable import PaddedArm
from servoloop.moveit.surroundings import ROOM_M, base_link, surroundings
from sim_backend.scene.cube_cell import BINS
from sim_backend.scene.world import SCENE, World
from tests.config.arm import ARM, CONFIG, DESCRIPTION, LINKS, MOVEIT, read, read_objects, states

REQUEST: Final = read(MOVEIT / "planning_scene.yaml")
PADDING: Final = read(MOVEIT / "joint_limits.yaml")["default_robot_padding"]
NODE: Final = read(CONFIG / "vision_pick_place_controller.yaml")["/**/vision_pick_place_controller"]["ros__parameters"]
POSES: Final = {**NODE["poses"], **{f"bin {name}": pose for name, pose in NODE["bins"].items()}}
GIVES_WAY_RAD_PER_NM: Final = 30 * 2 * np.pi / 4096
"""Deflection of an STS3215 per N m.

In a published bench test, a real servo with friction deflected by 20 to 30 counts at 1 N m. The virtual servo without
friction deflects by 42 counts (docs/simulation.md).
"""

SERVOS_LEAVE_RAD: Final = 0.006
"""Position error of a servo at rest with gravity compensation, in rad."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Box:
    """An axis-aligned box, given by its center and half its size in m."""

    middle: Numbers
    half: Numbers

    @property
    def top(self) -> float:
        return round(self.middle[2] + self.half[2], 9)

    def covers(self, x: float, y: float) -> bool:
        """Return whether the point is above or below the box or one of its edges."""
        offset = np.abs([x - self.middle[0], y - self.middle[1]])
        return bool((offset <= np.add(self.half[:2], 1e-9)).all())


def rounded(values: Any) -> Numbers:
    return tuple(round(float(value), 6) for value in values)


def in_the_file() -> dict[str, list[Box]]:
    found = {}
    for item in REQUEST["scene"]["world"]["collision_objects"]:
        assert [primitive["type"] for primitive in item["primitives"]] == [1] * len(item["primitive_poses"])
        assert all(set(pose) == {"position"} for pose in item["primitive_poses"])
        positions = [[pose["position"][axis] for axis in "xyz"] for pose in item["primitive_poses"]]
        sizes = [np.divide(primitive["dimensions"], 2) for primitive in item["primitives"]]
        found[item["id"]] = [Box(rounded(at), rounded(half)) for at, half in zip(positions, sizes, strict=True)]
    return found


def in_the_world(body: str) -> list[Box]:
    """Return the boxes of a fixed body of the world."""
    world = World()
    numbers = range(world.model.ngeom)
    geoms = [world.data.geom(i) for i in numbers if world.model.geom_bodyid[i] == world.model.body(body).id]
    assert all(world.model.geom(geom.id).type == mujoco.mjtGeom.mjGEOM_BOX for geom in geoms)
    assert all(np.allclose(geom.xmat, np.eye(3).ravel()) for geom in geoms)
    return [Box(rounded(geom.xpos), rounded(world.model.geom_size[geom.id])) for geom in geoms]


def test_the_request_adds_to_the_scene_of_move_group() -> None:
    scene = REQUEST["scene"]
    assert set(REQUEST) == {"scene"}
    assert set(scene) == {
        "is_diff",
        "robot_state",
        "world",
    }  # a padding here would replace the one in joint_limits.yaml
    assert scene["is_diff"] is True and scene["robot_state"] == {"is_diff": True}
    frames = {item["header"]["frame_id"] for item in scene["world"]["collision_objects"]}
    # No joint moves the root link.
    assert frames == LINKS - {joint.child for joint in DESCRIPTION.joints.values()}


def test_the_scene_has_every_body_of_the_world_except_arm_and_cube() -> None:
    world = World()
    bodies = [world.model.body(i) for i in range(world.model.nbody)]
    around = {body.name for body in bodies if body.name != "world" and body.name not in LINKS}
    assert set(in_the_file()) == {"table"} | around - {"cube"} == {"table", "stand", *(f"bin_{name}" for name in BINS)}


@pytest.mark.parametrize("name", BINS)
def test_bins_are_at_their_places_in_the_world(name: str) -> None:
    assert in_the_file()[f"bin_{name}"] == in_the_world(f"bin_{name}")


def test_the_stand_is_at_its_place_in_the_world_and_lower_by_more_than_the_padding() -> None:
    ((told,), (real,)) = in_the_file()["stand"], in_the_world("stand")
    assert (told.middle[:2], told.half[:2]) == (real.middle[:2], real.half[:2])
    assert told.top == pytest.approx(real.top - PADDING - ROOM_M)
    assert told.middle[2] - told.half[2] == pytest.approx(0.0)


def test_the_table_is_lower_than_in_the_world_only_below_the_foot_and_the_lying_arm() -> None:
    table = in_the_file()["table"]
    assert World().data.geom("table").xpos[2] == 0.0
    tops = set()
    for x, y in np.mgrid[-0.6:0.6:49j, -0.6:0.6:49j].reshape(2, -1).T:  # the fingers reach 0.52 m
        top = max(box.top for box in table if box.covers(x, y))
        below_foot = max(abs(x), abs(y)) < 0.085
        behind = -0.36 < x < -0.08 and abs(y) < 0.08  # the pose in which a parked arm is released
        assert top == 0.0 or below_foot or behind, (x, y)
        tops.add(top)
    assert min(tops) >= -PADDING - 2 * ROOM_M


def given_way(pose: Any) -> Any:
    """Return the positions that joints with the goal ``pose`` reach when the arm's weight deflects their servos."""
    world = World(initial_position=[*pose, 0.0])
    torque = [world.data.qfrc_bias[int(world.model.joint(name).dofadr[0])] for name in ARM]
    return np.array(pose) - np.multiply(torque, GIVES_WAY_RAD_PER_NM)


def distance(arm: PaddedArm, pose: Any, hand: float) -> float:
    """Return the distance between the arm and the nearest box, in m. The distance is negative inside a box."""
    return min(arm.distances({**dict(zip(ARM, pose, strict=True)), "hand_right_joint": hand}).values())


@pytest.fixture(scope="module")
def padded() -> PaddedArm:
    return PaddedArm(SCENE, read_objects(REQUEST), PADDING)


@pytest.mark.parametrize("hand", [NODE["hand_open_m"], 0.0275, NODE["hand_closed_m"]])
def test_moveit_accepts_the_poses_of_the_node(padded: PaddedArm, hand: float) -> None:
    """MoveIt rejects starts and goals in collision.

    The pose must therefore be free of collisions with the hand open, around a cube and closed.
    """
    named = {name: list(values.values()) for (group, name), values in states().items() if group == "arm"}
    parked = named.pop("park")
    assert distance(padded, parked, hand) > 0.001  # the table supports the parts that deflect here
    for name, pose in {**POSES, **named}.items():
        for place in (pose, given_way(pose)):
            assert distance(padded, place, hand) > 0.001, name


def test_moveit_rejects_poses_inside_stand_table_and_bins(padded: PaddedArm) -> None:
    """Below the pick and bin poses, the arm touches a box. The padding reduces the distance between the arm and the
    boxes."""
    for name in ("pick", *(name for name in POSES if name.startswith("bin"))):
        lower = np.add(POSES[name], [0, -0.25, -0.25, 0.25, 0.25, 0])
        assert distance(padded, lower, 0.0) < 0, name
    bare = PaddedArm(SCENE, read_objects(REQUEST), 0.0)
    assert distance(bare, POSES["pick"], 0.0) - distance(padded, POSES["pick"], 0.0) >= PADDING


def test_a_gripped_cube_does_not_touch_the_stand() -> None:
    """An attached object has the padding of the link that holds it. The hand sinks because of the position errors of
    the servos at rest."""
    world = World()
    cube, half = world.poses()["cube"].position_m, float(world.model.geom("cube").size[2])
    (stand,) = in_the_file()["stand"]
    pick = world_at(POSES["pick"])
    levers = [np.linalg.norm(cube[:2]) - np.linalg.norm(pick.data.joint(name).xanchor[:2]) for name in ARM[1:5]]
    sinks = SERVOS_LEAVE_RAD * float(np.abs(levers).max())
    assert cube[2] - half - PADDING - sinks > stand.top


def world_at(pose: Any) -> World:
    return World(initial_position=[*pose, 0.0])


def test_the_first_body_of_the_arm_may_have_any_name(tmp_path: Path) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE.read_text().replace('"base_link"', '"foot"'))
    assert surroundings(scene, PADDING, []) == surroundings(SCENE, PADDING, [])
    assert base_link(scene) == "foot"


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        ("<(actuator|keyframe)>.*?</\\1>", "", "no joint of the scene has an actuator: add an actuator for each joint"),
        ('<body name="base_link"', "<body", "the body on which the arm stands has no name: give it the name of the"),
    ],
)
def test_a_scene_without_an_arm_is_refused(tmp_path: Path, pattern: str, replacement: str, message: str) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(re.sub(pattern, replacement, SCENE.read_text(), flags=re.DOTALL))
    with pytest.raises(ArmFileError, match=f"scene.xml: {message}"):
        surroundings(scene, PADDING, [])

"""planning_scene.yaml holds the simulated world, and leaves the padded arm its places of work."""

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
import pytest

from sim_backend.scene.world import BINS, SCENE, World
from tests.config.arm import ARM, CONFIG, DESCRIPTION, LINKS, MOVEIT, read, states

REQUEST: Final = read(MOVEIT / "planning_scene.yaml")
PADDING: Final = read(MOVEIT / "joint_limits.yaml")["default_robot_padding"]
NODE: Final = read(CONFIG / "vision_pick_place_controller.yaml")["vision_pick_place_controller"]["ros__parameters"]
POSES: Final = {**NODE["poses"], **{f"bin {name}": pose for name, pose in NODE["bins"].items()}}
JOINTS: Final = (*ARM, "hand_right_joint", "hand_left_joint")
GIVES_WAY_RAD_PER_NM: Final = 30 * 2 * np.pi / 4096
"""An STS3215 gave way by 20 to 30 of its counts at 1 N m, with friction's help, on a published bench. The virtual one,
that no friction helps, gives way by 42 (docs/simulation.md)."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Box:
    """A box that is not turned: its middle and half its size, m."""

    middle: Numbers
    half: Numbers

    @property
    def top(self) -> float:
        return round(self.middle[2] + self.half[2], 9)

    def covers(self, x: float, y: float) -> bool:
        """Whether the box has the point above or below it, its edges included."""
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
    """The world builds a body that does not move of these boxes."""
    world = World()
    numbers = range(world.model.ngeom)
    geoms = [world.data.geom(i) for i in numbers if world.model.geom_bodyid[i] == world.model.body(body).id]
    assert all(world.model.geom(geom.id).type == mujoco.mjtGeom.mjGEOM_BOX for geom in geoms)
    assert all(np.allclose(geom.xmat, np.eye(3).ravel()) for geom in geoms)
    return [Box(rounded(geom.xpos), rounded(world.model.geom_size[geom.id])) for geom in geoms]


def test_the_request_adds_to_what_move_group_has() -> None:
    scene = REQUEST["scene"]
    assert set(REQUEST) == {"scene"}
    assert set(scene) == {
        "is_diff",
        "robot_state",
        "world",
    }  # a padding named here would end the one in joint_limits.yaml
    assert scene["is_diff"] is True and scene["robot_state"] == {"is_diff": True}
    frames = {item["header"]["frame_id"] for item in scene["world"]["collision_objects"]}
    assert frames == LINKS - {joint.child for joint in DESCRIPTION.joints.values()}  # the root: no joint moves it


def test_every_body_of_the_world_is_there_but_arm_and_cube() -> None:
    world = World()
    bodies = [world.model.body(i) for i in range(world.model.nbody)]
    around = {body.name for body in bodies if body.name != "world" and body.name not in LINKS}
    assert set(in_the_file()) == {"table"} | around - {"cube"} == {"table", "stand", *(f"bin_{name}" for name in BINS)}


@pytest.mark.parametrize("name", BINS)
def test_bins_are_where_the_world_has_them(name: str) -> None:
    assert in_the_file()[f"bin_{name}"] == in_the_world(f"bin_{name}")


def test_the_stand_is_where_the_world_has_it_and_lower_by_the_padding() -> None:
    ((told,), (real,)) = in_the_file()["stand"], in_the_world("stand")
    assert (told.middle[:2], told.half[:2]) == (real.middle[:2], real.half[:2])
    assert told.top == pytest.approx(real.top - PADDING)
    assert told.middle[2] - told.half[2] == pytest.approx(0.0)


def test_the_table_is_level_with_the_world_s_and_lower_only_around_the_foot() -> None:
    table = in_the_file()["table"]
    assert World().data.geom("table").xpos[2] == 0.0
    for x, y in np.mgrid[-0.6:0.6:49j, -0.6:0.6:49j].reshape(2, -1).T:  # the fingers reach 0.52 m
        top = max(box.top for box in table if box.covers(x, y))
        below_foot = max(abs(x), abs(y)) < 0.085
        assert top == (-0.025 if below_foot else 0.0), (x, y)


class PaddedArm:
    """MoveIt checks this arm against its surroundings: the boxes of the file.

    Padding makes boxes and cylinders longer at each end and thicker all around.
    """

    def __init__(self, padding: float) -> None:
        spec = mujoco.MjSpec.from_file(str(SCENE))
        for geom in spec.geoms:
            if geom.parent.name in LINKS:
                used = 3 if geom.type == mujoco.mjtGeom.mjGEOM_BOX else 2
                geom.size = [size + padding * (i < used) for i, size in enumerate(geom.size)]
        names = []
        for name, boxes in in_the_file().items():
            for i, box in enumerate(boxes):
                names.append(f"{name} {i}")
                spec.worldbody.add_geom(name=names[-1], type=mujoco.mjtGeom.mjGEOM_BOX, pos=box.middle, size=box.half)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._places = [int(self._model.joint(name).qposadr[0]) for name in JOINTS]
        owners = [self._model.body(body).name for body in self._model.geom_bodyid]
        self._arm = [i for i, owner in enumerate(owners) if owner in LINKS]
        self._boxes = [self._model.geom(name).id for name in names]

    def distance(self, pose: Any, hand: float) -> float:
        """The arm keeps this distance from the nearest box, m; negative where it is inside one."""
        self._data.qpos[self._places] = [*pose, hand, hand]
        mujoco.mj_kinematics(self._model, self._data)
        pairs = ((link, box) for link in self._arm for box in self._boxes)
        return min(float(mujoco.mj_geomDistance(self._model, self._data, *pair, 1.0, None)) for pair in pairs)


def given_way(pose: Any) -> Any:
    """The arm's weight moves servos that are told `pose` to here."""
    world = World(initial_position=[*pose, 0.0])
    torque = [world.data.qfrc_bias[int(world.model.joint(name).dofadr[0])] for name in ARM]
    return np.array(pose) - np.multiply(torque, GIVES_WAY_RAD_PER_NM)


@pytest.fixture(scope="module")
def padded() -> PaddedArm:
    return PaddedArm(PADDING)


@pytest.mark.parametrize("hand", [NODE["hand_open_m"], 0.0275, NODE["hand_closed_m"]])
def test_moveit_may_go_where_the_node_goes(padded: PaddedArm, hand: float) -> None:
    """A state in collision is neither start nor goal: told and given way, the hand open, around a cube and closed."""
    named = {name: list(values.values()) for (group, name), values in states().items() if group == "arm"}
    for name, pose in {**POSES, **named}.items():
        for place in (pose, given_way(pose)):
            assert padded.distance(place, hand) > 0.001, name


def test_moveit_may_not_go_into_stand_table_and_bins(padded: PaddedArm) -> None:
    """The arm is in a box further down from the pick and from each bin, and padding brings it nearer to one."""
    for name in ("pick", *(name for name in POSES if name.startswith("bin"))):
        lower = np.add(POSES[name], [0, -0.25, -0.25, 0.25, 0.25, 0])
        assert padded.distance(lower, 0.0) < 0, name
    assert PaddedArm(0.0).distance(POSES["pick"], 0.0) - padded.distance(POSES["pick"], 0.0) >= PADDING

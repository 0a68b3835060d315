"""The SRDF's self-collision matrix is what tools/collision_matrix.py finds, and hides no collision."""

import importlib.util
import itertools
from types import ModuleType
from typing import Any, Final

import numpy as np
import pytest

from tests.config.arm import CONFIG, DESCRIPTION, ROOT, SRDF, read

Pair = tuple[str, str]


def load_tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("collision_matrix", ROOT / "tools" / "collision_matrix.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TOOL: Final = load_tool()


@pytest.fixture(scope="module")
def arm() -> Any:
    return TOOL.Arm()


def disabled() -> dict[Pair, str]:
    elements = SRDF.findall("disable_collisions")
    found = {TOOL.pair(e.attrib["link1"], e.attrib["link2"]): e.attrib["reason"] for e in elements}
    assert len(found) == len(elements), "a pair is there twice"
    return found


@pytest.mark.slow
def test_the_file_is_what_the_tool_finds() -> None:
    assert disabled() == TOOL.reasons()


def test_adjacent_links_are_those_that_a_joint_of_the_urdf_joins() -> None:
    joined = {TOOL.pair(joint.parent, joint.child) for joint in DESCRIPTION.joints.values()}
    assert {links for links, reason in disabled().items() if reason == "Adjacent"} == joined


@pytest.mark.slow
def test_no_pair_that_never_touches_touches_in_other_poses(arm: Any) -> None:
    touched = TOOL.count(arm, 20_000, seed=2)
    never = {links for links, reason in disabled().items() if reason == "Never"}
    assert never and not never & touched.keys()


@pytest.mark.slow
def test_every_pair_that_is_checked_can_touch(arm: Any) -> None:
    checked = set(itertools.combinations(arm.links, 2)) - disabled().keys()
    assert checked <= TOOL.count(arm, 50_000, seed=4).keys()


def test_the_tool_sees_the_fingers_meet_and_the_forearm_fold_back(arm: Any) -> None:
    closed = np.array([0, 0, 0, 0, 0, 0, 0.05, 0.05])
    assert arm.touching(closed) == {("hand_left_link", "hand_right_link")}
    folded = np.array([0, 2, 2, 0, 0, 0, 0, 0])
    assert arm.touching(folded) == {("base_link", "link4"), ("link1", "link3"), ("link1", "link4")}


def test_the_node_s_poses_are_free_of_collisions(arm: Any) -> None:
    node = read(CONFIG / "vision_pick_place_controller.yaml")
    parameters = node["vision_pick_place_controller"]["ros__parameters"]
    for pose in (*parameters["poses"].values(), *parameters["bins"].values()):
        assert arm.touching(np.array([*pose, 0.0, 0.0])) == set(), pose

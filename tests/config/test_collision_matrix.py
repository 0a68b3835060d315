"""Tests that the self-collision matrix of the SRDF equals that of tools/collision_matrix.py and hides no collision."""

import itertools
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from servoloop.motion_planning.collision_matrix import LinkModel, Pair, count, pair, reasons
from sim_backend.scene.world import SCENE
from tests.config.arm import CONFIG, DESCRIPTION, ROOT, SRDF, read


@pytest.fixture(scope="module")
def arm() -> LinkModel:
    return LinkModel(SCENE)


def disabled() -> dict[Pair, str]:
    elements = SRDF.findall("disable_collisions")
    found = {pair(e.attrib["link1"], e.attrib["link2"]): e.attrib["reason"] for e in elements}
    assert len(found) == len(elements), "a pair is listed twice"
    return found


@pytest.mark.slow
def test_the_file_equals_the_output_of_the_tool() -> None:
    assert disabled() == reasons(SCENE)


def test_adjacent_links_are_connected_by_a_joint_of_the_urdf() -> None:
    joined = {pair(joint.parent, joint.child) for joint in DESCRIPTION.joints.values() if joint.kind != "fixed"}
    assert {links for links, reason in disabled().items() if reason == "Adjacent"} == joined


@pytest.mark.slow
def test_pairs_marked_never_do_not_touch_in_other_poses(arm: LinkModel) -> None:
    touched = count(arm, 20_000, seed=2)
    never = {links for links, reason in disabled().items() if reason == "Never"}
    assert never and not never & touched.keys()


@pytest.mark.slow
def test_every_checked_pair_can_touch(arm: LinkModel) -> None:
    checked = set(itertools.combinations(arm.links, 2)) - disabled().keys()
    assert checked <= count(arm, 50_000, seed=4).keys()


def run_tool(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    tool = ROOT / "tools" / "collision_matrix.py"
    monkeypatch.setattr(sys, "argv", [str(tool), *words])
    runpy.run_path(str(tool), run_name="__main__")


@pytest.mark.parametrize("name", ["so101", "so100", "koch"])
def test_the_tool_works_for_any_arm(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_tool(monkeypatch, name, "--samples", "100")
    printed = capsys.readouterr().out
    assert 'reason="Adjacent"' in printed and 'reason="Never"' in printed and "gripper_link" in printed


def test_the_tool_lists_the_arms(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SystemExit, match=r"there is no arm so999: choose one of .*so101"):
        run_tool(monkeypatch, "so999")


def turning_scene(tmp_path: Path, limits: str) -> Path:
    """Return a scene in which link2 overlaps the base if j2 is near 0."""
    path = tmp_path / "scene.xml"
    path.write_text(
        f"""
        <mujoco>
          <compiler angle="radian"/>
          <worldbody>
            <body name="base_link">
              <geom type="box" size="0.1 0.1 0.1"/>
              <body name="link1" pos="0 0 0.5">
                <joint name="j1" axis="0 0 1" range="-1 1"/>
                <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
                <body name="link2">
                  <joint name="j2" axis="0 1 0" {limits}/>
                  <geom type="box" size="0.02 0.02 0.2" pos="0 0 -0.25"/>
                </body>
              </body>
            </body>
          </worldbody>
          <actuator>
            <motor joint="j1"/>
            <motor joint="j2"/>
          </actuator>
        </mujoco>
        """
    )
    return path


def test_links_that_overlap_only_at_a_zero_outside_the_range_are_checked(tmp_path: Path) -> None:
    scene = turning_scene(tmp_path, 'range="0.4 6.2"')
    assert ("base_link", "link2") not in reasons(scene, samples=200)
    assert LinkModel(scene).default_pose().tolist() == pytest.approx([0.0, 3.3])
    assert reasons(turning_scene(tmp_path, 'range="-0.4 6.2"'), samples=200)["base_link", "link2"] == "Default"


def test_random_poses_turn_a_hinge_without_limits(tmp_path: Path) -> None:
    turning = LinkModel(turning_scene(tmp_path, ""))
    random = np.random.default_rng(1)
    turns = [turning.random_pose(random)[1] for _ in range(100)]
    assert -np.pi <= min(turns) < -3.0 and 3.0 < max(turns) <= np.pi


def test_the_tool_detects_meeting_fingers_and_a_folded_forearm(arm: LinkModel) -> None:
    closed = np.array([0, 0, 0, 0, 0, 0, 0.05, 0.05])
    assert arm.touching(closed) == {("hand_left_link", "hand_right_link")}
    folded = np.array([0, 2, 2, 0, 0, 0, 0, 0])
    assert arm.touching(folded) == {("base_link", "link4"), ("link1", "link3"), ("link1", "link4")}


def test_the_poses_of_the_node_are_free_of_collisions(arm: LinkModel) -> None:
    node = read(CONFIG / "vision_pick_place_controller.yaml")
    parameters = node["/**/vision_pick_place_controller"]["ros__parameters"]
    for pose in (*parameters["poses"].values(), *parameters["bins"].values()):
        assert arm.touching(np.array([*pose, 0.0, 0.0])) == set(), pose

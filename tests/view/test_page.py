"""Content of the page (arm, ghost, path and colors), without a browser."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hal.robot_description.link_meshes import PLACES
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.page import Page
from servoloop.dashboard.scene import CELL, COMMANDED, HOT_C, MEASURED, PATH, TEMPERATURE, THINGS, color_of
from servoloop.dashboard.server import PageServer
from servoloop.dashboard.shapes import thing_shapes
from servoloop.recording.robot_state import health
from servoloop.recording.sampler import scene_poses
from tests.hal.test_link_meshes import cube, write_stl
from tests.recorder.rig import Rig
from tests.stack.rig import READY
from tests.view.rig import received, watched

HAND = "/base_link/link1/link2/link3/link4/link5/gripper_base_link"


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


def node(server: PageServer, name: str) -> Any:
    return server.scene.get_handle_by_name(name)


def test_the_arm_is_drawn_as_measured_and_the_ghost_as_commanded(server: PageServer) -> None:
    rig, page = Rig(), Page(server)
    rig.stack.go([*READY[:5], READY[5] + 1.0], 1.0)
    rig.run(0.5)
    seen = watched(rig)
    page.show_arm(seen)
    snapshot = seen.state.snapshot
    turn, command = snapshot.position[5], snapshot.command[5]
    assert abs(command - turn) > 0.01, "the arm must be moving"
    for root, angle in ((MEASURED, turn), (COMMANDED, command)):
        w, *_, z = node(server, root + HAND).wxyz
        assert 2.0 * np.arctan2(z, w) == pytest.approx(angle, abs=1e-6)
    assert node(server, f"{COMMANDED}{HAND}/shape15").opacity < 1.0 and node(server, f"{CELL}/0") is not None


def test_the_cube_is_drawn_at_its_simulated_pose_or_hidden(server: PageServer) -> None:
    rig, page = Rig(), Page(server)
    rig.run(0.2)
    seen = watched(rig)
    page.show_arm(seen)
    cube = node(server, f"{THINGS}/cube")
    assert not cube.visible and node(server, f"{THINGS}/bin_A") is None
    sample = replace(rig.samples[-1], scene=scene_poses(rig.stack.scene))
    for one in received(rig, [sample]):
        seen.take(one)
    page.show_arm(seen)
    place, turn = rig.stack.scene()["cube"]
    assert cube.visible and tuple(cube.position) == pytest.approx(place)
    assert tuple(cube.wxyz) == pytest.approx((turn[3], *turn[:3]))
    (shape,) = thing_shapes(rig.stack.files.scene)
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([0.045] * 3) and shape.rgb[0] > shape.rgb[1]


def test_the_path_is_drawn_while_its_goal_is_active(server: PageServer) -> None:
    rig, page = Rig(), Page(server)
    rig.stack.go([0.4, *READY[1:]], 1.0)
    rig.run(0.5)
    seen = watched(rig)
    page.show_arm(seen)
    points, snapshot = node(server, PATH).points, seen.state.snapshot
    model = DrawnArm(rig.stack.files.description.joints, snapshot.joints)
    end = model.place("gripper_base_link", np.array([0.4, *READY[1:], 0.0]))
    np.testing.assert_allclose(points[-1, 1], end, atol=1e-3)
    rig.run(3.0)
    page.show_arm(watched(rig))
    assert node(server, PATH) is None


def test_the_hottest_joint_is_red_and_the_others_are_as_described(
    server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, page = Rig(), Page(server)
    rig.run(0.2)
    seen = watched(rig)
    page.show_arm(seen)
    said = health(seen.state.snapshot)
    hot = np.where(np.arange(len(said.temperature_c)) == 2, HOT_C, np.nan)
    monkeypatch.setattr("servoloop.dashboard.page.health", lambda _: said._replace(temperature_c=hot))
    page._colors.value = TEMPERATURE
    page.show_numbers(seen)
    link3, link2 = "/base_link/link1/link2/link3/shape8", "/base_link/link1/link2/shape6"
    assert tuple(node(server, MEASURED + link3).color) == color_of(1.0)
    assert tuple(node(server, MEASURED + link2).color) != color_of(1.0)
    assert tuple(node(server, COMMANDED + link3).color) != color_of(1.0), "the ghost keeps its color"
    assert "27" in page._servos.content and "control loop" in page._loop.content


def test_the_link_of_a_servo_with_a_fault_is_red(server: PageServer) -> None:
    rig, page = Rig(), Page(server)
    rig.run(0.2)
    page.show_arm(watched(rig))
    link3 = f"{MEASURED}/base_link/link1/link2/link3/shape8"
    page.show_numbers(watched(rig))
    assert tuple(node(server, link3).color) != color_of(1.0)
    rig.stack.bus.faults.silence(3)
    rig.run(2.0)
    seen = watched(rig)
    page.show_arm(seen)
    page.show_numbers(seen)
    assert tuple(node(server, link3).color) == color_of(1.0)


def test_another_arm_replaces_the_first(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, page = Rig(), Page(server)
    rig.run(0.2)
    page.show_arm(watched(rig))
    seen = watched(rig)
    xml = seen.state.snapshot.description_xml.replace("link3", "forearm")
    monkeypatch.setattr(seen.state, "_now", replace(seen.state.snapshot, description_xml=xml))
    page.show_arm(seen)
    assert node(server, f"{MEASURED}/base_link/link1/link2/link3") is None
    assert node(server, f"{MEASURED}/base_link/link1/link2/forearm") is not None
    assert node(server, f"{CELL}/0") is None, "the surroundings of this arm are unknown"


def test_a_user_arm_is_drawn_with_the_meshes_of_its_folder(server: PageServer, tmp_path: Path) -> None:
    """The meshes are read from the folder of the arm. The same URDF belongs to an included arm without meshes."""
    rig, page = Rig(), Page(server, tmp_path)
    files = rig.stack.files
    (tmp_path / "arm.yaml").write_text("description: mine\n")
    shutil.copy(files.urdf_path, tmp_path / "arm.urdf")
    (tmp_path / PLACES).parent.mkdir()
    (tmp_path / PLACES).write_text("links: {link3: [{mesh: cube.stl, rgb: [0.2, 0.4, 0.6]}]}\n")
    write_stl(tmp_path / "meshes" / "cube.stl", cube())
    rig.run(0.2)
    page.show_arm(watched(rig))
    shapes = (node(server, f"{MEASURED}/base_link/link1/link2/link3/shape{number}") for number in range(50))
    assert [tuple(shape.color) for shape in shapes if shape is not None] == [(51, 102, 153)]
    assert node(server, f"{CELL}/0") is None, "the folder has no scene"

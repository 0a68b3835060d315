"""Objects of the planning scene and the plan on the page, without a browser and without ROS."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planning.scene import Box, Cone, Cylinder, Mesh, Pose, Shape, Sphere
from servoloop.dashboard.page import Page
from servoloop.dashboard.planned import HELD, OBJECTS, PLANNED, mesh_of
from servoloop.dashboard.scene import MEASURED
from servoloop.dashboard.server import PageServer
from tests.recorder.rig import Rig
from tests.view.rig import watched

HAND = "/base_link/link1/link2/link3/link4/link5/gripper_base_link"
TRIANGLES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
WALL, LARGE = Box(0.1, 0.1, 0.4), Box(20.0, 20.0, 0.1)


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


def item(name: str, shape: Shape, link: str = "") -> Any:
    return SimpleNamespace(name=name, link=link, shapes=((shape, Pose(np.array([0.3, 0.0, 0.2]))),))


class Planner:
    """A planner whose scene and time the test sets."""

    def __init__(self) -> None:
        self.scene: Any = SimpleNamespace(items=(), plan=None)
        self.now_s = 0.0

    def __call__(self) -> tuple[Any, float]:
        return self.scene, self.now_s


def node(server: PageServer, name: str) -> Any:
    return server.scene.get_handle_by_name(name)


def test_objects_are_drawn_in_the_world_or_at_their_link_until_they_are_removed(server: PageServer) -> None:
    rig, planner = Rig(), Planner()
    page = Page(server, planner=planner)
    rig.run(0.2)
    things = (item("wall", WALL), item("table", LARGE), item("stand", WALL), item("part", WALL, "gripper_base_link"))
    planner.scene = SimpleNamespace(items=things, plan=None)
    page.show_arm(watched(rig))
    assert tuple(node(server, f"{OBJECTS}0_0").position) == (0.3, 0.0, 0.2)
    assert node(server, f"{OBJECTS}1_0") is None, "too large to draw"
    assert node(server, f"{OBJECTS}2_0") is None, "the page draws the stand of the arm's scene itself"
    assert node(server, f"{MEASURED}{HAND}/{HELD}3_0") is not None
    planner.scene = SimpleNamespace(items=(), plan=None)
    page.show_arm(watched(rig))
    assert node(server, f"{OBJECTS}0_0") is None
    assert node(server, f"{MEASURED}{HAND}/{HELD}3_0") is None


def test_ghost_follows_the_plan_and_disappears_after_it(server: PageServer) -> None:
    rig, planner = Rig(), Planner()
    page = Page(server, planner=planner)
    rig.run(0.2)
    page.show_arm(watched(rig))
    assert not node(server, PLANNED).visible
    plan = SimpleNamespace(joints=("joint1",), times_s=np.array([0.0, 2.0]), positions=np.array([[0.0], [1.0]]))
    planner.scene = SimpleNamespace(items=(), plan=plan)
    for planner.now_s, expected in ((10.0, 0.0), (11.0, 0.5), (13.0, 1.0)):
        page.show_arm(watched(rig))
        w, *_, z = node(server, f"{PLANNED}/base_link/link1").wxyz
        assert 2.0 * np.arctan2(z, w) == pytest.approx(expected, abs=1e-6)
        assert node(server, PLANNED).visible
    planner.now_s = 14.5
    page.show_arm(watched(rig))
    assert not node(server, PLANNED).visible


@pytest.mark.parametrize(
    ("shape", "extents_m"),
    [
        (Box(0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        (Cylinder(0.3, 0.1), (0.2, 0.2, 0.3)),
        (Cone(0.3, 0.1), (0.2, 0.2, 0.3)),
        (Sphere(0.1), (0.2, 0.2, 0.2)),
        (Mesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]]), TRIANGLES), (0.1, 0.2, 0.3)),
    ],
)
def test_shapes_are_drawn_in_their_size_around_their_origin(shape: Shape, extents_m: tuple[float, ...]) -> None:
    mesh = mesh_of(shape)
    assert mesh.extents == pytest.approx(extents_m, abs=2e-3)
    if not isinstance(shape, Mesh):
        assert mesh.bounds.mean(axis=0) == pytest.approx(0.0, abs=1e-9)

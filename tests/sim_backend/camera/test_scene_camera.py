"""The camera that a scene defines is compared with the frames of the robot description."""

import mujoco
import numpy as np
import pytest

from hal.robot_description.description import parse_urdf
from hal.robot_description.kinematics import child_pose, multiply, rotate
from servoloop.stack.arm_folders import find_arm
from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.scene.scene_file import scene_model
from tests.pages import code

ARMS = ("robot_arm", "robot_arm_dynamixel", "so101")


@pytest.fixture(params=ARMS)
def arm(request):
    return find_arm(request.param)


def test_the_scene_and_the_description_agree(arm):
    joints = parse_urdf(arm.urdf.read_text()).joints
    (link_m, link), (optical_m, optical) = (
        child_pose(joints[name], 0.0) for name in ("camera_joint", "camera_optical_joint")
    )
    assert joints["camera_joint"].parent == "base_link"
    camera = camera_of(arm)
    np.testing.assert_allclose(camera.position_m, np.add(link_m, rotate(link, optical_m)), atol=1e-5)
    axes = np.empty(9)
    x, y, z, w = multiply(link, optical)
    mujoco.mju_quat2Mat(axes, np.array([w, x, y, z]))
    np.testing.assert_allclose(camera.axes, axes.reshape(3, 3), atol=1e-5)


def test_the_camera_sees_the_stand_in_the_middle(arm):
    pixel = camera_of(arm).pixels(scene_model(arm.scene).body("cube").pos[None])[0]
    np.testing.assert_allclose(pixel, [319.5, 239.5], atol=40.0)


@pytest.mark.runs("sort-apples.md xml 1")
def test_the_documented_elements_are_those_of_the_scene():
    scene = [line.strip() for line in find_arm("robot_arm").scene.read_text().splitlines()]
    assert [line for line in code("sort-apples.md", "xml").splitlines() if line not in scene] == []


def camera_of(arm):
    model = scene_model(arm.scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return PinholeCamera.of(model, data, "camera")

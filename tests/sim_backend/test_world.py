"""The world without a stack: positions, states at rest, and the place of the cube."""

import numpy as np
import pytest

from sim_backend.scene.hand import SceneHand, handle_hand_command
from sim_backend.scene.world import World
from tests.sim_backend.robot_arm import JOINTS, READY

POSES = {
    "ready": READY[:6],
    "pick": (0.0, -0.35, -0.70, -0.70, -1.10, 1.55),
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}
NO_EFFORT = [0.0] * 7


def put_cube(world, x, y, z):
    """Place the cube level at a position, and let it settle."""
    world.cell.feed_cube()
    world.data.body("cube")
    world.data.qpos[world.cell.qpos][:3] = (x, y, z)
    for _ in range(400):
        world.step(NO_EFFORT)


def folded():
    """Return a world in which the arm leans back, away from the cube."""
    return World(initial_position=[0.0, 1.5, 0.5, 0.0, 0.0, 0.0, 0.0])


def test_the_world_starts_at_ready_with_the_cube_on_the_stand():
    world = World()
    assert world.joints == JOINTS
    np.testing.assert_allclose(world.position(), READY)
    np.testing.assert_array_equal(world.velocity(), np.zeros(7))
    assert world.time_s == 0.0
    assert world.cell.cube_on_stand() and world.cube_bin() is None
    assert set(world.poses()) == {"cube", "bin_A", "bin_B", "bin_C"}


def test_position_and_velocity_are_copies():
    world = World()
    before = world.position()
    world.step([1.0] * 7)
    np.testing.assert_allclose(before, READY)


@pytest.mark.parametrize("pose", POSES)
def test_gravity_needs_less_than_half_of_a_servos_torque(pose):
    world = World(initial_position=[*POSES[pose], 0.0])
    assert np.abs(world.data.qfrc_bias[world._qvel])[:6].max() < 1.0


@pytest.mark.parametrize("grade", "ABC")
def test_a_cube_in_a_bin_is_in_that_bin(grade):
    world = folded()
    x, y, z = world.poses()[f"bin_{grade}"].position_m
    # 4 cm outward, so that the stand in the middle of bin B is not in the way
    put_cube(world, x + (0.04 if grade == "B" else 0.0), y, z + 0.03)
    assert world.cube_bin() == grade and not world.cell.cube_on_stand()


def test_a_cube_on_the_stand_or_on_the_table_is_in_no_bin():
    world = folded()
    put_cube(world, *world.cell.home[:3])
    assert world.cell.cube_on_stand() and world.cube_bin() is None
    put_cube(world, 0.1, 0.3, 0.025)
    assert not world.cell.cube_on_stand() and world.cube_bin() is None and world.cell.cube_at_rest()


def test_contacts_of_the_arm_are_named_without_those_of_the_cube():
    assert World(initial_position=[*POSES["pick"], 0.05]).arm_contacts() == set()
    low = World(initial_position=[0.0, -0.9, *POSES["pick"][2:], 0.0]).arm_contacts()
    assert low == {"hand_left_link and table", "hand_right_link and table"}


def test_a_falling_cube_is_in_no_bin():
    world = folded()
    x, y, z = world.poses()["bin_A"].position_m
    world.data.qpos[world.cell.qpos][:3] = (x, y, z + 0.04)
    for _ in range(30):
        world.step(NO_EFFORT)
    assert not world.cell.cube_at_rest() and world.cube_bin() is None


def test_a_fed_cube_stays_at_rest():
    world = folded()
    put_cube(world, 0.1, 0.3, 0.025)
    world.cell.feed_cube()
    assert world.cell.cube_on_stand()
    for _ in range(1000):
        world.step(NO_EFFORT)
    assert world.cell.cube_on_stand()


def test_open_fingers_stay_clear_of_the_cube_from_ready_to_pick():
    ready, pick = np.array(READY[:6]), np.array(POSES["pick"])
    for share in np.linspace(0.0, 1.0, 41):
        world = World(initial_position=[*(ready + share * (pick - ready)), 0.0])
        assert world.cell.stand_free() and not world.cell.cube_touched()


def test_closed_fingers_occupy_the_place_of_the_cube():
    assert not World(initial_position=[*POSES["pick"], 0.04]).cell.stand_free()


def test_the_cube_is_touched_when_the_fingers_close_on_it():
    world = World(initial_position=[*POSES["pick"], 0.0275])
    world.data.qfrc_applied[world._qvel] = world.data.qfrc_bias[world._qvel]
    for _ in range(100):
        world.step([0, 0, 0, 0, 0, 0, 40.0])
    assert world.cell.cube_touched()


def test_a_hand_command_without_effect_is_refused():
    hand = SceneHand(World(), {"joint2": 1.0, "joint3": 1.0})
    with pytest.raises(
        ValueError, match=r"99 is far outside the range of joint2, -?\d\.\d+ to \d\.\d+: pass a position"
    ):
        handle_hand_command(hand, list, {"do": "move", "joints": ["joint2"], "position": 99})
    with pytest.raises(ValueError, match="connect needs a box of servos: start the emulator with 'servoloop emulate"):
        handle_hand_command(hand, list, {"do": "connect"})
    assert list(handle_hand_command(hand, list, {"do": "look", "joints": ["joint3"]})) == ["joint3"]


@pytest.mark.parametrize("released_first", [True, False])
def test_a_hand_and_a_load_act_together_and_leave_nothing_behind(released_first):
    world = World()
    hand, joint = SceneHand(world, {"joint2": 1.0}), world.data.joint("joint2")
    hand.move("joint2", 1.0)
    hand.update()
    world.load("joint2", 4.0)
    hand.update()
    held = float(joint.qfrc_applied[0]) - 4.0
    assert 0.0 < held < 0.2
    ends = [hand.release, lambda: world.load("joint2", -4.0)]
    first, last = ends if released_first else reversed(ends)
    first()
    assert joint.qfrc_applied[0] == pytest.approx(4.0 if released_first else held)
    last()
    assert joint.qfrc_applied[0] == 0.0


def test_the_same_efforts_give_the_same_world():
    def end():
        world, random = World(), np.random.default_rng(1)
        for _ in range(500):
            world.step(random.normal(size=7))
        return world.data.qpos.tobytes() + world.data.qvel.tobytes()

    assert end() == end()


def test_an_arm_without_rest_pose_is_held_until_an_effort_acts() -> None:
    world = World()
    world.hold_until_driven()
    for _ in range(2000):
        world.advance()
    assert np.abs(world.position() - world.ready).max() == 0.0
    world.step([0.0, 0.01, *[0.0] * 5])
    for _ in range(200):
        world.step([0.0] * 7)
    assert np.abs(world.position() - world.ready).max() > 0.01

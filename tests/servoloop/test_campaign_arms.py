"""Some runs of a campaign begin with a joint outside its limits, or with a servo that has another setting."""

from pathlib import Path

from drivers.servos.catalog import registers_of
from hal.types import OUTSIDE_TOLERANCE, JointLimits
from servoloop.campaign.campaign import files_of, read_scenario, run_schedule_of, schedule_of
from servoloop.campaign.draws.arm import draw_jam, draw_limits, draw_setting
from servoloop.simulation.acts import Move
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, read_schedule, schedule_text

JOINTS = {"a": JointLimits(-1.91986, 1.91986, 1.0, 5.0, 50.0), "b": JointLimits(-1.0, 1.0, 1.0, 5.0, 50.0)}
START = {"a": 1.5, "b": -1.0}


def test_drawn_limits_are_within_those_of_the_joint_and_exclude_its_position_but_not_the_park_pose() -> None:
    drawn = [limits for seed in range(2000) if (limits := draw_limits(seed, JOINTS, START, {"b": 0.0}))]
    outside: set[bool] = set()
    for limits in drawn:
        ((name, (lower, upper)),) = limits.items()
        assert JOINTS[name].lower <= lower < upper <= JOINTS[name].upper
        distance = max(lower - START[name], START[name] - upper) / (upper - lower)
        assert 0.0 < distance < 0.25 and (name == "a" or lower < 0.0 < upper)
        outside.add(distance > OUTSIDE_TOLERANCE)
    assert outside == {False, True} and {next(iter(one)) for one in drawn} == {"a", "b"}
    assert 0.1 < len(drawn) / 2000 < 0.2


def test_a_joint_slightly_outside_returns_and_one_far_outside_is_not_activated() -> None:
    near = Schedule(seconds=3.0, limits={"joint6": (-1.61, 3.05)}, clients=(Move(positions={"joint1": 0.2}),))
    stacks: list[FaultyStack] = []
    report = run_schedule_of(near, stacks.append)
    assert report.violations == () and report.ended == ""
    assert stacks[0].loop.command[5] >= -1.61
    far = near.model_copy(update={"limits": {"joint6": (-0.9, 3.05)}})
    assert run_schedule_of(far).ended.startswith("not activated: joint6 (servo 6) is at -1.68")


def test_a_goal_where_the_joint_stands_is_accepted_and_ends_at_the_limit() -> None:
    stacks: list[FaultyStack] = []
    stands = Move(positions={"joint6": -1.65}, seconds=1.0)
    report = run_schedule_of(Schedule(seconds=4.0, limits={"joint6": (-1.61, 3.05)}, clients=(stands,)), stacks.append)
    assert report.violations == ()
    (logged,) = stacks[0].goals.goals
    assert logged.handle.done and stacks[0].loop.command[5] == -1.61


def test_saved_schedules_keep_the_limits(tmp_path: Path) -> None:
    scenario = read_scenario(Path("docs/campaign.yaml"))
    schedule = next(one for seed in range(100) if (one := schedule_of(scenario, seed)).limits)
    path = tmp_path / "schedule.yaml"
    path.write_text(schedule_text(schedule))
    assert read_schedule(path) == schedule


def test_a_drawn_setting_is_one_of_the_robot_file_and_the_stack_writes_it() -> None:
    joints = files_of("so101").robot.joints
    drawn = [one for seed in range(300) for one in draw_setting(seed, joints)]
    assert 10 < len(drawn) < 60
    gripper = next(joint for joint in joints if joint.name == "gripper")
    wanted = dict(gripper.settings)
    assert {one.register_name for one in drawn} == set(wanted)
    stacks: list[FaultyStack] = []
    assert all(one.servo_id == 6 and one.value != wanted[one.register_name] for one in drawn)
    report = run_schedule_of(Schedule(arm="so101", seconds=0.5, faults=(drawn[0],)), stacks.append)
    assert report.violations == () and report.ended == ""
    wrong = drawn[0]
    register = next(one for one in registers_of(gripper.model) if one.name == wrong.register_name)
    assert stacks[0].bus.servo(6).memory.get(register) == wanted[wrong.register_name]


def test_a_drawn_jam_stops_the_hand_during_the_run() -> None:
    hand = [joint for joint in files_of("so101").robot.joints if joint.name == "gripper"]
    drawn = [one for seed in range(100) for one in draw_jam(seed, hand, 8.0)]
    assert 50 < len(drawn) < 90 and draw_jam(0, [], 8.0) == ()
    assert all(one.servo_id == 6 and 0.0 <= one.at_s <= 8.0 and one.for_s is not None for one in drawn)

"""Two leaders and two followers, each pair with its own ports."""

from pathlib import Path

import pytest

from drivers.servos import sts
from servoloop.arms.combine import combine, parse_bases
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.teleop.arms import TeleopError
from servoloop.teleop.pairs import bus_names, port_pairs
from tests.teleop.rig import REST, Rig

NAMES = ("left", "right")


def test_each_follower_follows_its_own_leader(tmp_path: Path) -> None:
    combine(tmp_path / "leaders", dict.fromkeys(NAMES, "so101_leader"), parse_bases([], NAMES))
    leaders = read_arm_files(find_arm(str(tmp_path / "leaders")))
    rest = {f"{name}_{joint}": position for name in NAMES for joint, position in REST.items()}
    rig = Rig(leader=rest, follower=rest, arms=(leaders, read_arm_files(find_arm("bimanual_so101")))).follow()
    rig.hand = lambda time_s: {**rest, "left_shoulder_pan": 0.5, "right_elbow_flex": 0.4}
    rig.run(4.0)
    there = dict(zip(rig.loop.hardware.joints, rig.states[-1].position.tolist(), strict=True))
    assert (there["left_shoulder_pan"], there["right_elbow_flex"]) == pytest.approx((0.5, 0.4), abs=0.03)
    assert (there["right_shoulder_pan"], there["left_elbow_flex"]) == pytest.approx((0.0, 0.9), abs=0.03)
    servos = [servo for line in rig.leader.lines.values() for servo in line.servos]
    assert len(servos) == 12 and not any(servo.memory.get(sts.torque_enable) for servo in servos)


def test_ports_are_assigned_to_the_buses_of_the_follower_in_pairs() -> None:
    assert bus_names("bimanual_so101") == NAMES and bus_names("so101") == ("",)
    assert port_pairs(["a", "b"], NAMES, NAMES) == ("a", "b")
    assert port_pairs(["ll", "lf", "rl", "rf"], ("right", "left"), NAMES) == ("left=ll,right=rl", "left=lf,right=rf")


@pytest.mark.parametrize(
    ("ports", "leader", "message"),
    [
        (["a"], ("",), "1 ports cannot form leader-follower pairs"),
        (["a", "b", "c"], NAMES, "3 ports cannot form leader-follower pairs"),
        (["a", "b", "c", "d"], ("",), r"2 pairs of ports do not match the buses of the leader \(one without a name\)"),
        (["a", "b"] * 3, NAMES, "3 pairs of ports do not match .*combine the arms of each side with `servoloop arms"),
    ],
)
def test_ports_that_do_not_fit_are_refused(ports: list[str], leader: tuple[str, ...], message: str) -> None:
    with pytest.raises(TeleopError, match=message):
        port_pairs(ports, leader, NAMES)

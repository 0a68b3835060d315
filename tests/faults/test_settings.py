"""Wrong settings and loose plugs: impossible faults are refused, and the stack handles all others at activation."""

import pytest

from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from hal.lifecycle import LifecycleState
from sim_backend.faults.draw import draw
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.settings import OWN_KINDS, WrongSetting
from sim_backend.faults.targets import Inventory
from sim_backend.faults.text import parse
from tests.faults.rig import FaultRig
from tests.faults.test_moments import life


@pytest.mark.parametrize(
    ("text", "model", "why"),
    [
        ("wrong_setting id=1 register=id value=4", sts.STS3215, "use the fault wrong_id for this register"),
        (
            "wrong_setting id=1 register=torque_enable value=0",
            sts.STS3215,
            "is not a setting that an sts3215 keeps without",
        ),
        (
            "wrong_setting id=1 register=model_number value=1",
            sts.STS3215,
            "is not a setting that an sts3215 keeps without",
        ),
        ("wrong_setting id=1 register=position_p value=256", sts.STS3215, "position_p must be 0 to 255, not 256"),
        ("wrong_setting id=1 register=position_p value=9", x.XL430_W250, "has no register 'position_p'"),
    ],
)
def test_wrong_values_that_a_register_cannot_have_are_refused(text: str, model: ServoModel, why: str) -> None:
    with pytest.raises(FaultError, match=why):
        parse(text).refuse(Inventory({"": {1: model}}))


def test_eeprom_settings_without_their_own_kind_are_drawn() -> None:
    there = Inventory({"": {1: sts.STS3215, 2: sts.STS3215}})
    events = [event for seed in range(40) for event in draw(seed, there, 10.0, 10, ["wrong_setting"])]
    names = {event.register_name for event in events if isinstance(event, WrongSetting)}
    assert {"position_p", "homing_offset", "max_position", "status_level"} < names
    assert not names & {*OWN_KINDS, "model_number", "torque_enable"}


def test_limits_that_restrict_a_joint_are_refused_at_activation() -> None:
    report = life("wrong_setting id=3 register=max_position value=1600 since=start")
    assert "joint3" in report.ended and "has position limits" in report.ended
    assert report.violations == ()


def test_a_setting_is_restored_when_the_fault_ends() -> None:
    rig = FaultRig()
    rig.up()
    servo = rig.bus.servo(3)
    usual = servo.memory.get(sts.position_p)
    rig.play(parse("wrong_setting id=3 register=position_p value=2 for=0.2s"))
    rig.endure(0.1)
    assert servo.memory.get(sts.position_p) == 2
    rig.endure(0.2)
    assert servo.memory.get(sts.position_p) == usual


def test_torque_stays_off_after_a_loose_plug() -> None:
    rig = FaultRig()
    rig.up()
    rig.play(parse("loose_plug id=3 every=0.3s for=1s"))
    rig.endure(0.9)
    assert rig.bus.servo(3).deaf
    rig.endure(1.5)
    assert not rig.bus.servo(3).deaf and rig.bus.servo(3).memory.get(sts.torque_enable) == 0
    assert rig.made[0].state is LifecycleState.ACTIVE and rig.says("servo 3 returned with its torque disabled")

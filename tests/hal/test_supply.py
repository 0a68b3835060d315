"""Tests of the supply voltage: servos outside their rated range get no torque, and each period outside the range is
reported once."""

import pytest

from controller.diagnostics import Level, Status, statuses
from drivers.driver_errors import DriverError
from drivers.servos import sts, x
from drivers.servos.catalog import MODELS
from drivers.servos.register import ServoModel
from drivers.servos.voltage import usual_range, voltage_fault, voltage_range
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from sim_backend.faults import Disturbance
from sim_backend.faults.text import parse
from sim_backend.line.power import feed
from sim_backend.packets.instructions import Instruction
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line
from tests.faults.rig import FaultRig
from tests.hal.bench import JOINTS, Bench

INACTIVE = LifecycleState.INACTIVE
SYNC_READ = 0x82


def arm_on(line: Line, model: ServoModel, servo_id: int) -> ServoHardware:
    joint = Joint("j", servo_id, model, JointLimits(-0.3, 0.3, 3.0, 5.0, 50.0), zero_counts=(model.last_count + 1) // 2)
    return ServoHardware("arm", [joint], lambda: line.bus, line.clock)


def fed_with(bench: Bench, voltage_v: float) -> None:
    feed(bench.servos, voltage_v)
    bench.clock.sleep_until(bench.clock.now() + 0.01)  # servos measure periodically


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("wrong", ["too much", "too little"])
def test_servos_of_every_make_are_refused_outside_the_range_of_their_model(kind: Kind, wrong: str) -> None:
    model, servo_id = kind.models[IDS[0]], IDS[0]
    lowest, highest = voltage_range(model)
    line = Line(kind)
    feed(line.servos, highest + 0.3 if wrong == "too much" else lowest - 0.3)
    line.clock.sleep_until(line.clock.now() + 0.05)
    with pytest.raises(DriverError, match=rf"^j: servo {servo_id}: has [0-9.]+ V, but an {model.name} is rated for"):
        arm_on(line, model, servo_id).configure()


@pytest.mark.parametrize("voltage_v", [15.5, 6.0])
def test_a_supply_changed_while_inactive_keeps_torque_disabled(voltage_v: float) -> None:
    bench = Bench().configured()
    fed_with(bench, voltage_v)
    with pytest.raises(ActivationError, match=rf"^not activated: shoulder: servo 1: has {voltage_v} V, but an sts3215"):
        bench.hardware.activate()
    assert (bench.hardware.state, bench.torque()) == (INACTIVE, [])


def test_one_reading_of_a_wrong_voltage_does_not_refuse_activation() -> None:
    bench = Bench()
    fed_with(bench, 6.0)
    readings: list[int] = []

    def recover(number: int, instruction: Instruction) -> None:
        if instruction.code == SYNC_READ:
            readings.append(number)
            if len(readings) == 2:
                fed_with(bench, 12.0)

    bench.port.before_write = recover
    bench.hardware.configure()
    assert bench.hardware.state is INACTIVE


@pytest.mark.parametrize("seed", range(20))
def test_lost_replies_do_not_hide_a_wrong_supply(seed: int) -> None:
    bench = Bench().configured()
    fed_with(bench, 15.5)
    bench.servos.faults.disturbance = Disturbance(seed=seed, drop=0.09)
    with pytest.raises(ActivationError) as refused:
        bench.hardware.activate()
    assert bench.torque() == []
    assert str(refused.value).count("has 15.5 V") == len(JOINTS), refused.value


def test_a_servo_that_does_not_measure_voltage_is_not_checked() -> None:
    assert voltage_fault(sts.STS3215, 0.0) is None


def test_nothing_is_written_to_servos_with_a_wrong_supply() -> None:
    joints = (Joint("j", 1, sts.STS3215, JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0), settings=(("position_p", 16),)),)
    bench = Bench(counts=(2048,), joints=joints)
    fed_with(bench, 15.5)
    with pytest.raises(DriverError, match=r"has 15\.5 V"):
        bench.hardware.configure()
    assert bench.held(1, sts.position_p) == 32


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_every_range_includes_the_rated_voltage_with_ten_percent_tolerance(model: ServoModel) -> None:
    lowest, highest = usual_range(model)
    assert voltage_range(model)[0] <= lowest <= 0.9 * model.rated_voltage_v
    assert 1.1 * model.rated_voltage_v <= highest <= voltage_range(model)[1]


@pytest.mark.parametrize(
    ("model", "voltage_v", "kind"),
    [
        (sts.STS3215_C001, 12.4, "over-voltage"),
        (sts.STS3215_C001, 9.0, "over-voltage"),
        (sts.STS3215_C001, 8.4, None),  # voltage of a full battery
        (sts.STS3215_C001, 5.0, "low supply"),  # many such arms have this supply
        (sts.STS3215_C001, 4.0, "under-voltage"),
        (sts.STS3215, 12.6, None),
        (sts.STS3215, 7.4, "under-voltage"),
        (x.XL330_M288, 12.0, "over-voltage"),
        (x.XL330_M288, 6.2, "over-voltage"),
        (x.XM430_W350, 14.8, "high supply"),  # four cells
        (x.XL430_W250, 5.0, "under-voltage"),
        (x.XL430_W250, 7.4, "low supply"),
    ],
)
def test_messages_about_voltages(model: ServoModel, voltage_v: float, kind: str | None) -> None:
    fault = voltage_fault(model, voltage_v)
    assert (fault and fault.kind) == kind


# During motion


def fed(voltage_v: float, seconds: float, then_s: float = 0.0) -> FaultRig:
    """Run an SO-101 with a supply of ``voltage_v`` for ``seconds``, and then with a normal supply for ``then_s``."""
    rig = FaultRig("so101")
    rig.up()
    rig.play(parse(f"weak_supply voltage={voltage_v} for={seconds}s"))
    rig.endure(seconds + then_s - 0.01)
    return rig


def shown(rig: FaultRig, joint: str) -> Status:
    ids = dict.fromkeys(rig.loop.hardware.joints, "1")
    found = statuses(rig.loop, "arm", ids, rig.hardware.read())
    return next(status for status in found if joint in status.name)


def logged(rig: FaultRig, words: str) -> list[str]:
    return [text for text in rig.said if "log: " in text and words in text]


@pytest.mark.parametrize(
    ("voltage_v", "kind", "level"),
    [(12.4, "over-voltage", Level.ERROR), (4.2, "under-voltage", Level.ERROR), (5.0, "low supply", Level.WARN)],
)
def test_a_wrong_voltage_in_motion_is_reported_and_logged_once(voltage_v: float, kind: str, level: Level) -> None:
    rig = fed(voltage_v, 1.0)
    status = shown(rig, "shoulder_pan")
    assert status.level == level and status.message.startswith(f"{kind}: the servo has {voltage_v}"), status.message
    assert len(logged(rig, f"{kind}: shoulder_pan (servo 1), shoulder_lift (servo 2), ")) == 1
    assert len(logged(rig, f"gripper (servo 6) have {voltage_v} V, but an sts3215_c001 is rated for")) == 1
    rig.endure(1.5)
    assert len(logged(rig, kind)) == 1, "one line for all servos"
    assert len(logged(rig, "gripper (servo 6) have a correct voltage again: 7.4 V")) == 1
    assert shown(rig, "shoulder_pan").message == "ok"


def test_a_short_dip_or_peak_is_not_reported() -> None:
    rig = fed(4.2, 0.2, then_s=1.5)
    assert logged(rig, "voltage") == []
    assert shown(rig, "shoulder_pan").level is Level.OK


def test_a_supply_that_sags_in_each_motion_is_one_episode() -> None:
    rig = fed(4.2, 0.6, then_s=0.3)
    rig.play(parse("weak_supply voltage=4.2 for=0.6s"))
    rig.endure(0.9)
    assert len(logged(rig, "under-voltage: shoulder_pan")) == 1


def test_an_so101_with_a_supply_for_other_servos_gets_no_torque() -> None:
    rig = FaultRig("so101")
    feed(rig.bus, 12.4)
    with pytest.raises(DriverError, match=r"^shoulder_pan: servo 1: has 12\.4 V, but an sts3215_c001 is"):
        rig.up()


def test_an_so101_with_five_volts_starts() -> None:
    rig = FaultRig("so101")
    feed(rig.bus, 5.0)
    rig.up()
    rig.endure(0.5)
    assert len(logged(rig, "low supply: shoulder_pan (servo 1), shoulder_lift (servo 2), ")) == 1

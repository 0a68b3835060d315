"""False values with a valid checksum: the possible registers, how often they occur, and their effect on the motion."""

from collections import Counter

import pytest

from drivers.servos import ax_mx, scs, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import PROTOCOL_2
from drivers.servos.register import ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.faults.draw import draw
from sim_backend.faults.false_replies import READ_IN_CYCLES, FalseValue
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.tables import register_of
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.faults.text import parse
from sim_backend.mechanics.plant import BenchPlant
from tests.faults.rig import FaultRig, told

MODELS = (sts.STS3215, scs.SCS0009, ax_mx.AX_12A, ax_mx.MX_28, x.XL430_W250, x.XL330_M288, xl320.XL320)


def there(model: ServoModel) -> Inventory:
    return Inventory({"": dict.fromkeys((1, 2), model)})


def drawn(model: ServoModel) -> list[FalseValue]:
    events = [event for seed in range(40) for event in draw(seed, there(model), 10.0, 10, ["false_value"])]
    return [event for event in events if isinstance(event, FalseValue)]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_all_registers_read_in_the_cycle_are_drawn(model: ServoModel) -> None:
    events = drawn(model)
    assert {"present_voltage", "present_temperature", "torque_enable"} < {event.register_name for event in events}
    assert {event.register_name for event in events} <= set(READ_IN_CYCLES)


def test_drawn_values_are_small_and_large_single_and_lasting() -> None:
    events = drawn(sts.STS3215)
    assert {"present_velocity", "present_load", "status"} < {event.register_name for event in events}
    velocities = [event.value for event in events if event.register_name == "present_velocity"]
    assert min(velocities) < -1000 and max(velocities) > 1000 and 0 in velocities
    assert any(0 < abs(value) < 30 for value in velocities)
    forms = Counter((event.replies == 1, event.every > 1) for event in events)
    assert all(forms[form] > 0.05 * len(events) for form in ((True, False), (False, True), (False, False)))


@pytest.mark.parametrize(
    ("text", "model", "why"),
    [
        (
            "false_value id=1 register=status value=4",
            x.XL430_W250,
            "an xl430-w250 has no register 'status': `servoloop register list`",
        ),
        (
            "false_value id=1 register=present_voltage value=256",
            sts.STS3215,
            "present_voltage must be 0 to 255, not 256",
        ),
        ("false_value id=1 register=nonsense value=1", sts.STS3215, "an sts3215 has no register 'nonsense'"),
    ],
)
def test_values_that_the_model_cannot_report_are_refused(text: str, model: ServoModel, why: str) -> None:
    with pytest.raises(FaultError, match=why):
        parse(text).refuse(there(model))


@pytest.mark.parametrize(
    ("text", "false_cycles"),
    [
        ("false_value id=3 register=present_temperature value=66 replies=1", 1),
        ("false_value id=3 register=present_temperature value=66 every=3 for=0.6s", 4),
        ("false_value id=3 register=present_temperature value=66 for=0.5s", 10),
    ],
)
@pytest.mark.parametrize("arm", ["robot_arm", "robot_arm_dynamixel"])
def test_a_value_is_false_once_in_each_n_th_reply_or_always(arm: str, text: str, false_cycles: int) -> None:
    rig, seen = FaultRig(arm), list[float]()
    rig.on_state = lambda state: seen.append(state.health["joint3"].temperature_c)
    rig.up()
    rig.run(0.2)
    rig.play(parse(text))
    rig.endure(1.0)
    assert abs(seen.count(66.0) - false_cycles) <= 1
    assert seen[-1] < 60.0


@pytest.mark.parametrize(
    "text", ["false_value id=1 register=baud_rate value=200", "false_position id=1 counts=1000000"]
)
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_the_servo_reports_every_value_and_then_works_as_before(model: ServoModel, text: str) -> None:
    protocol, plant = series_of(model).protocol, BenchPlant([1])
    line = VirtualDynamixelBus.of(plant, {1: model}) if protocol is PROTOCOL_2 else VirtualBus.of(plant, model)
    line.advance(0.0)
    event, player = parse(text), FaultPlayer(FaultTargets({"": line}))
    register = register_of(model, getattr(event, "register_name", "present_position"))
    request = protocol.packets.packet(1, 2, protocol.packets.span(register.address, register.size))

    def reported() -> list[bytes]:
        return [reply.data for reply in line.receive(request, 0.0)]

    true = reported()
    player.play([event])
    player.begin_due(0.0)
    false = reported()
    assert len(false) == 1 and false != true
    player.cancel(lambda _: True)
    assert reported() == true


def test_a_false_status_is_sent_in_the_error_byte() -> None:
    """The value 32 is the overload bit, for which an STS only reduces its torque."""
    rig = told("robot_arm", parse("false_value id=3 register=status value=32 for=0.3s"))
    assert rig.says("joint3: alarm: overload") and rig.says("goal: SUCCEEDED")

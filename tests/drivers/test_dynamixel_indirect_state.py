"""Reading the whole state through indirect registers: packets, validation of the map, and behavior without
validation."""

import contextlib
import importlib
import logging
import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.bus.late_replies import OPEN_S
from drivers.driver_errors import ServoError, ServoRefused
from drivers.protocol import v2 as wire
from drivers.servos import indirect, x, xl320
from drivers.servos.dynamixel import ALARMED
from drivers.servos.indirect import AT_208, AT_224, MAP, block_for
from drivers.servos.register import Register
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.faults import Disturbance
from sim_backend.packets.dynamixel import Code
from sim_backend.servos.dynamixel.indirect import windows_of
from sim_backend.servos.dynamixel.protocol2_memory import ACCESS, DATA_RANGE
from sim_backend.servos.dynamixel.servo import VirtualXServo
from tests.drivers.cycles import exchange
from tests.drivers.dynamixel_lines import TrueLine
from tests.drivers.fault_lines import CYCLES
from tests.drivers.tape import Tape

# The module is imported by name, because it has no types.
sdk: Any = importlib.import_module("dynamixel_sdk")
has_fast_sync_read = pytest.mark.skipif(
    not hasattr(sdk.GroupSyncRead, "fastSyncReadTxPacket"), reason="this version of the SDK has no fast sync read"
)

SEVEN = {i: x.XL430_W250 if i % 2 else x.XM430_W350 for i in range(1, 8)}
MIXED = {1: x.XL430_W250, 2: x.XL330_M288, 3: x.XC330_T288, 4: x.MX_28_2}
OLD_AND_NEW = {2: 52, 3: 53}
OVERLOAD = 1 << 5


def seven() -> TrueLine:
    return TrueLine(SEVEN).identified()


def mixed() -> TrueLine:
    return TrueLine(MIXED, OLD_AND_NEW).identified()


# Single reads


def test_one_read_per_cycle_has_the_names_of_all_alarms() -> None:
    line = seven()
    line.errors.update({2: OVERLOAD, 5: 1 << 0 | 1 << 2})
    readings = line.cycle()
    assert [r.alarms for r in readings.values() if isinstance(r, ServoState)] == [
        (), ("overload",), (), (), ("voltage", "temperature"), (), (),
    ]  # fmt: skip
    (question,) = line.taken()
    assert question.code == Code.FAST_SYNC_READ
    assert question.parameters == bytes((224, 0, 18, 0, *line.ids))


def test_firmware_without_fast_reads_uses_plain_sync_reads() -> None:
    line = TrueLine(SEVEN, dict.fromkeys(SEVEN, 44)).identified()
    line.errors[3] = OVERLOAD
    reading = line.cycle()[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("overload",)
    assert [i.code for i in line.taken()] == [Code.SYNC_READ]


def test_servos_with_different_cell_addresses_are_read_by_a_bulk_read() -> None:
    line = mixed()
    line.errors[3] = OVERLOAD
    reading = line.cycle()[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("overload",)
    (question,) = line.taken()
    assert question.code == Code.BULK_READ
    assert question.parameters == bytes.fromhex("01e0001200 02d0001200 03e0001200 04e0001200")


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
@pytest.mark.parametrize("firmware", [46, 53])
def test_the_state_of_every_model_matches_its_registers(model: Any, firmware: int) -> None:
    line = TrueLine({1: model}, {1: firmware}).identified()
    block = block_for(model, firmware)
    assert block is not None
    window = windows_of(model, firmware)[0]
    assert (indirect.POINTERS, block.address) == (window.addresses, window.data)
    assert block.size <= window.count
    assert line.mapped() == {1}
    cells = line.servos.servo(1).memory.read(block.address, block.size)
    shown = {}
    at = 1
    for register in indirect._SHOWN:
        shown[register.name] = register.decode(cells[at : at + register.size], "little")
        at += register.size
    assert at == block.size - 1
    assert shown.pop("present_current") == 3 - line.number % 50
    assert shown == {name: line.bus.read(1, getattr(x, name)) for name in shown}


AMPERES = {
    **dict.fromkeys(("xl330", "xc330", "xc335"), 0.001),
    **dict.fromkeys(("xm430", "xd430", "xm540", "xh540", "xd540", "xw540", "xw430", "xh430-w"), 0.00269),
    **dict.fromkeys(("mx-64", "mx-106"), 0.00336),
    "xh430-v": 0.00134,
}
"""Unit of the current, by the beginning of the model's name, in A."""


@pytest.mark.parametrize("mapped", [True, False])
@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_the_current_is_in_amperes_if_the_model_measures_it(model: Any, mapped: bool) -> None:
    unit_a = next((unit for name, unit in AMPERES.items() if model.name.startswith(name)), None)
    line = TrueLine({1: model}).identified() if mapped else TrueLine({1: model})
    for number in (7, 49):
        line.number = number
        for deadline_s in (None, line.clock.now() + 0.02):
            reading = line.bus.read_states((1,), deadline_s)[1]
            assert isinstance(reading, ServoState)
            assert reading.current_a == (unit_a and pytest.approx((3 - number) * unit_a))
    assert (line.mapped() == {1}) is mapped


def test_models_with_and_without_a_current_share_one_fast_read() -> None:
    line = TrueLine({1: x.XL430_W250, 2: x.XL330_M288, 3: x.XM430_W350}, {2: 53}).identified()
    readings = line.cycle()
    assert [i.code for i in line.taken()] == [Code.FAST_SYNC_READ]
    assert [r.current_a is None for r in readings.values() if isinstance(r, ServoState)] == [True, False, False]


def test_a_replaced_servo_has_the_current_unit_of_its_model() -> None:
    """The bus was created for a different model."""
    line = TrueLine({1: x.XM430_W350})
    line.bus = Bus(line.port, line.clock, {1: x.XM430_W210})
    for model, current in ((x.XM430_W350, 2 * 0.00269), (x.XL330_M288, 0.002), (x.XL430_W250, None)):
        line.servos.servo(1).memory.put(x.model_number, model.number)
        line.bus.identify(1, model)
        line.number = 1
        reading = line.bus.read_states((1,))[1]
        assert isinstance(reading, ServoState)
        assert reading.current_a == current


def test_a_servo_that_is_not_identified_is_read_from_the_direct_block() -> None:
    line = TrueLine(SEVEN)
    line.cycle()
    assert [i.parameters[:4] for i in line.taken()] == [bytes((124, 0, 23, 0))]
    assert block_for(xl320.XL320, 46) is None


# Bytes


@has_fast_sync_read
@pytest.mark.parametrize(("block", "models"), [(AT_224, SEVEN), (AT_208, {1: x.XL330_M288, 2: x.XC330_M181})])
def test_requests_equal_those_of_the_sdk(block: Any, models: Any) -> None:
    for fast, firmware in ((True, 46), (False, 40)):
        line = TrueLine(models, dict.fromkeys(models, firmware)).identified()
        tape, ours = Tape(), Tape()
        group = sdk.GroupSyncRead(tape, sdk.PacketHandler(2.0), block.address, 18)
        assert all(group.addParam(i) for i in line.ids)
        (group.fastSyncReadTxPacket if fast else group.txPacket)()
        line.port.write = ours.write  # type: ignore[method-assign]
        line.bus.read_states(line.ids, line.clock.now() + 0.05)
        assert ours.sent.startswith(tape.sent)


def test_a_bulk_request_equals_that_of_the_sdk() -> None:
    line = mixed()
    tape, ours = Tape(), Tape()
    group = sdk.GroupBulkRead(tape, sdk.PacketHandler(2.0))
    for servo_id in line.ids:
        assert group.addParam(servo_id, 208 if servo_id == 2 else 224, 18)
    group.txPacket()
    line.port.write = ours.write  # type: ignore[method-assign]
    line.bus.request(line.ids, math.inf)
    assert ours.sent == tape.sent


@pytest.mark.parametrize(
    ("firmware", "identified", "size"), [(46, False, 218), (46, True, 183), (40, False, 259), (40, True, 224)]
)
def test_the_bytes_of_a_read_of_seven_servos(firmware: int, identified: bool, size: int) -> None:
    """The size covers requests and replies. If the state is read from the direct block, an alarm costs 26 more bytes
    and one more adapter delay."""
    line = TrueLine(SEVEN, dict.fromkeys(SEVEN, firmware))
    line = line.identified() if identified else line
    line.bus.read_states(line.ids)
    assert line.bus.exchange_size({}, line.ids) == size


def test_the_map_contains_the_registers_and_its_own_ends() -> None:
    places = [int.from_bytes(MAP[i : i + 2], "little") for i in range(0, len(MAP), 2)]
    assert places == [168, 70, *range(124, 136), *range(144, 147)[:0], *places[14:]]
    assert places[14:] == [144, 145, 146, 202]
    assert (AT_224.proof, AT_208.proof) == ((168, 202),) * 2


# Proof


def test_cells_after_a_reset_are_not_a_state() -> None:
    for block in (AT_208, AT_224):
        assert block.decode(None, 0, bytes(18)) is None


@given(st.binary(min_size=18, max_size=18))
def test_a_state_needs_both_proofs(data: bytes) -> None:
    assert (AT_224.decode(None, 0, data) is None) == ((data[0], data[-1]) != (168, 202))


@pytest.mark.parametrize("make", [seven, mixed], ids=["fast", "bulk"])
def test_a_reset_servo_is_a_fault_then_read_directly_and_mapped_with_its_torque(
    make: Any, caplog: pytest.LogCaptureFixture
) -> None:
    for victim in make().ids:
        line = make()
        line.cycle()
        line.reset(victim)
        caplog.clear()
        readings = line.cycle()
        fault = readings.pop(victim)
        assert isinstance(fault, ServoFault)
        assert (fault.kind, "lost the map" in fault.text) == ("reset", True)
        assert all(isinstance(reading, ServoState) for reading in readings.values())
        assert line.mapped() == set(line.ids) - {victim}
        for _ in range(30):
            assert line.faults() == {}
        assert line.mapped() == set(line.ids) - {victim}
        line.bus.torque_on(victim)
        for _ in range(5):
            assert line.faults() == {}
        assert line.mapped() == set(line.ids)
        assert [r.levelname for r in caplog.records if f"servo {victim} has lost" in r.message] == ["WARNING"]
        account = line.bus.counters.of(victim)
        assert (account.reset, account.corrupt, account.silent, account.late) == (1, 0, 0, 0)
        assert line.bus.counters.faults()["reset"] == account.as_dict()["reset"] == 1


def test_all_servos_are_reset_at_once() -> None:
    line = seven()
    for servo_id in line.ids:
        line.reset(servo_id)
    assert line.faults() == dict.fromkeys(line.ids, "reset")
    assert line.faults() == {}
    assert line.mapped() == set()
    for servo_id in line.ids:
        line.bus.torque_on(servo_id)
    assert line.faults() == {}
    assert line.mapped() == set(line.ids)


def test_a_rebooted_servo_is_silent_and_then_read_directly() -> None:
    line = seven()
    line.port.write(wire.packet(3, Code.REBOOT, b""))
    kinds = [line.faults() for _ in range(60)]
    assert kinds[0] == {3: "silent"}
    assert {3: "reset"} in kinds
    assert kinds[-1] == {}
    assert line.mapped() == set(line.ids) - {3}


def test_torque_is_enabled_even_if_the_map_cannot_be_restored() -> None:
    line = seven()
    line.reset(5)
    line.cycle()
    refusing(line, 5, ACCESS)
    line.bus.torque_on(5)
    assert line.bus.torque_is_on(5)
    assert line.faults() == {}
    assert line.mapped() == set(line.ids) - {5}


@pytest.mark.parametrize(("firmware", "faulty"), [(46, 1), (44, 1)], ids=["fast", "plain"])
def test_a_servo_without_the_mapped_cells_is_read_directly(firmware: int, faulty: int) -> None:
    """The servo was replaced by a servo whose table ends before the indirect cells."""
    line = TrueLine(SEVEN, dict.fromkeys(SEVEN, firmware)).identified()
    servo = line.servos.servo(6)
    read = servo._read
    servo._read = lambda address, size: (ACCESS, b"") if address >= 208 else read(address, size)  # type: ignore[method-assign]
    assert sum(6 in line.faults() for _ in range(400)) == faulty
    line.clock.sleep_until(line.clock.now() + 1.0)
    assert line.mapped() == set(line.ids) - {6}
    retries = line.bus.counters.of(6).retries
    for _ in range(5):
        assert line.faults() == {}
    assert line.bus.counters.of(6).retries == retries
    assert line.bus._reader._group.fast.known == (firmware == 46)


# Set-up


def refusing(line: TrueLine, servo_id: int, error: int) -> None:
    """Firmware that refuses writes of indirect addresses."""
    memory = line.servos.servo(servo_id).memory
    write = memory.write

    def write_some(address: int, data: bytes) -> int:
        return error if address == indirect.POINTERS else write(address, data)

    memory.write = write_some  # type: ignore[method-assign]


def forgetful(line: TrueLine, servo_id: int) -> None:
    """Firmware that accepts the addresses but does not keep them."""
    refusing(line, servo_id, 0)


def blind(line: TrueLine, servo_id: int) -> None:
    """Firmware whose cells cannot show an indirect address."""
    memory = line.servos.servo(servo_id).memory
    read = memory.read
    memory.read = lambda address, size: bytes(size) if address >= 208 else read(address, size)  # type: ignore[method-assign]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda line, i: refusing(line, i, DATA_RANGE), "received a value out of range"),
        (lambda line, i: refusing(line, i, ACCESS), "does not have this register"),
        (forgetful, "did not keep the map"),
        (blind, "did not return the mapped registers"),
    ],
    ids=["range", "access", "forgetful", "blind"],
)
def test_a_servo_without_a_map_is_read_directly_and_logged_once(
    spoil: Any, says: str, caplog: pytest.LogCaptureFixture
) -> None:
    line = TrueLine(SEVEN)
    spoil(line, 5)
    with caplog.at_level(logging.INFO, "servoloop.drivers"):
        line.identified()
        line.identified()
        line.errors[5] = OVERLOAD
        for _ in range(50):
            assert line.faults() == {}
    (message,) = [r.message for r in caplog.records if "direct block" in r.message]
    assert "servo 5" in message
    assert says in message
    assert line.mapped() == set(line.ids) - {5}
    reading = line.cycle()[5]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("overload",)  # by a second read


def test_a_lost_reply_during_set_up_is_requested_again() -> None:
    line = TrueLine(SEVEN)
    for servo_id, model in SEVEN.items():
        line.servos.faults.corrupt_next(servo_id, 0)
        line.bus.identify(servo_id, model)
    writes = 0
    fault = line.servos.faults
    write = line.port.write

    def spoiled(data: bytes) -> None:
        nonlocal writes
        if data[7] == wire.WRITE and not writes:
            writes += 1
            fault.corrupt_next(data[4])
        write(data)

    line.port.write = spoiled  # type: ignore[method-assign]
    line.bus.identify(3, SEVEN[3])
    assert writes == 1
    assert 3 in line.mapped()


def test_mapping_writes_no_other_register_and_works_with_torque_enabled() -> None:
    """Values that another program has stored in the cells are not overwritten."""
    line = TrueLine(SEVEN)
    for servo in line.servos.servos:
        assert servo.write(x.torque_enable.address, b"\x01") == 0
        assert servo.write(indirect.POINTERS, b"\x40\0\x74\0\x75\0\x76\0\x77\0") == 0
    before = {i: bytes(line.servos.servo(i).memory._bytes) for i in line.ids}
    line.identified()
    assert line.mapped() == set(line.ids)
    for servo_id, table in before.items():
        after = line.servos.servo(servo_id).memory._bytes
        changed = {at for at, (old, new) in enumerate(zip(table, after, strict=True)) if old != new}
        state = {at for r in indirect._SHOWN for at in range(r.address, r.address + r.size)}
        assert changed - state <= set(range(indirect.POINTERS, indirect.POINTERS + len(MAP)))
        assert line.bus.torque_is_on(servo_id)


def test_goals_torque_and_a_different_baud_rate_work_with_a_map() -> None:
    line = mixed()
    states = exchange(line.bus, {i: ServoGoal(100 * i) for i in line.ids}, line.ids, line.clock.now() + 0.012)
    assert all(isinstance(state, ServoState) for state in states.values())
    assert [i.code for i in line.taken()] == [Code.BULK_READ, Code.SYNC_WRITE]
    assert [line.bus.goal(i) for i in line.ids] == [100 * i for i in line.ids]
    line.bus.torque_on(1)
    assert line.bus.torque_off(line.ids) == []
    assert sum(i.code == Code.SYNC_WRITE for i in line.taken()) == 1
    with line.bus.at_baud(1_000_000) as other:
        assert all(isinstance(state, ServoState) for state in other.read_states(line.ids).values())
    assert line.mapped() == set(line.ids)


def test_an_alarm_without_a_name_is_reported_without_a_second_read() -> None:
    line = seven()
    line.errors[1] = 1 << 7
    line.number += 1
    reading = line.bus.read_states(line.ids, line.clock.now() + 0.012)[1]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("unknown (bit 7)",)
    assert reading.alarms != ALARMED
    assert [i.code for i in line.taken()] == [Code.FAST_SYNC_READ]


# Line errors


@pytest.mark.parametrize("servo_id", SEVEN)
def test_a_late_reply_is_never_taken_for_the_current_reply(servo_id: int) -> None:
    line = TrueLine(SEVEN, dict.fromkeys(SEVEN, 44)).identified()
    for number in range(60):
        if number % 5 == 0:
            line.servos.faults.delay_next(servo_id)
        line.cycle()
        line.number += 1  # replies to earlier requests are outdated from now on
    assert line.bus.counters.of(servo_id).late > 0
    line.clock.sleep_until(line.clock.now() + 1.0)
    for _ in range(5):
        line.cycle()
    assert line.mapped() == set(line.ids)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("make", "firmware"),
    [(SEVEN, {}), (SEVEN, dict.fromkeys(SEVEN, 44)), (MIXED, OLD_AND_NEW)],
    ids=["fast", "plain", "bulk"],
)
def test_thousands_of_cycles_with_line_errors_and_resets(make: Any, firmware: Any) -> None:
    """Every value is correct and from this cycle, despite lost, corrupt and late replies and resets."""
    line = TrueLine(make, firmware).identified()
    line.errors[2] = OVERLOAD
    chance = random.Random(7)
    line.servos.faults.disturbance = Disturbance(seed=3, drop=0.02, flip=0.02, noise=0.02)
    states = resets = 0
    for _ in range(CYCLES):
        for servo_id in line.ids:
            if chance.random() < 0.002:
                resets += 1
                line.reset(servo_id)
        if chance.random() < 0.02:
            line.servos.faults.delay_next(chance.choice(line.ids))
        states += sum(isinstance(reading, ServoState) for reading in line.cycle().values())
        if chance.random() < 0.02:
            with contextlib.suppress(ServoError):
                line.bus.torque_on(chance.choice(line.ids))
    assert resets > CYCLES * len(line.ids) * 0.001
    assert states > 0.96 * CYCLES * len(line.ids)  # a lost reply also silences the servos after it
    assert 0 < line.bus.counters.faults()["reset"] <= resets
    line.servos.faults.disturbance = None
    line.clock.sleep_until(line.clock.now() + OPEN_S)
    line.cycle()  # the last reset may be detected only in this cycle
    for servo_id in line.ids:
        with contextlib.suppress(ServoRefused):  # an overload disables torque
            line.bus.torque_on(servo_id)
    assert line.mapped() == set(line.ids)


def test_a_reset_before_any_packet_never_causes_a_wrong_value() -> None:
    """In each run, the servo is reset before a different packet, including the packets that write the map, read it back
    and write it again."""
    for when in range(40):
        line = TrueLine({1: x.XL430_W250, 2: x.XM430_W350})
        sent = 0
        write = line.port.write

        def counted(data: bytes, line: TrueLine = line, write: Any = write, when: int = when) -> None:
            nonlocal sent
            if sent == when:
                line.reset(1)
            sent += 1
            write(data)

        line.port.write = counted  # type: ignore[method-assign]
        for servo_id, model in line.models.items():
            line.bus.identify(servo_id, model)
        for _ in range(60):
            line.cycle()
        assert sent > when


def test_a_virtual_servo_loses_its_map_like_a_real_one() -> None:
    servo = VirtualXServo(x.XL430_W250, 1)
    register = Register("map", indirect.POINTERS, len(MAP))
    assert servo.write(register.address, MAP) == 0
    assert servo.memory.read(224, 1) == b"\xa8"
    assert servo.memory.read(241, 1) == b"\xca"
    servo.power_cycle()
    assert servo.memory.read(224, 18) == bytes(18)


def test_indirect_reads_work_with_an_echo() -> None:
    line = TrueLine(SEVEN)
    own = b""
    write, read, discard = line.port.write, line.port.read, line.port.discard_input

    def echoing(data: bytes) -> None:
        nonlocal own
        write(data)
        own += data

    def heard(size: int, deadline_s: float) -> bytes:
        nonlocal own
        begin, own = own[:size], own[size:]
        return begin + read(size - len(begin), deadline_s)

    def discarded() -> None:
        nonlocal own
        own = b""
        discard()

    line.port.write, line.port.read, line.port.discard_input = echoing, heard, discarded  # type: ignore[method-assign]
    line.identified()
    line.reset(3)
    assert line.faults() == {3: "reset"}
    line.bus.torque_on(3)
    for _ in range(40):
        assert line.faults() == {}
    assert line.mapped() == set(line.ids)

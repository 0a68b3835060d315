"""Backup, clear, secondary ID, protocol type and broadcast reset of virtual X servos, as in the e-manual."""

import pytest

from drivers.protocol.v2 import packet
from drivers.servos import x
from drivers.servos.catalog import registers_of
from drivers.servos.register import Register
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import BROADCAST, Code
from sim_backend.servos.dynamixel.protocol2_servo import REBOOT_S
from tests.sim_backend.dynamixel_bench import Bench, handler, sdk

FAIL, INSTRUCTION, DATA_RANGE, ACCESS = 1, 2, 4, 7
STORE, RESTORE = b"\x01CTRL", b"\x02CTRL"
CLEAR = b"\x01\x44\x58\x4c\x22"


def send(bench: Bench, code: int, parameters: bytes, servo_id: int = 1) -> int | None:
    """Send an instruction. Return the error number in the reply, or None if there is no error."""
    request = packet(servo_id, code, parameters)
    replies = bench.bus.receive(request, bench.clock.now())
    bench.run(0.01)
    return replies[0].data[8] if replies else None


def restart(bench: Bench) -> None:
    handler.reboot(bench.port, 1)
    bench.run(REBOOT_S + 0.01)


def test_the_tables_have_the_startup_configuration() -> None:
    for model in x.MODELS.values():
        names = {register.name for register in registers_of(model)}
        assert ("startup_configuration" in names) == ("backup_ready" in names) == (not model.name.startswith("mx"))


@pytest.mark.parametrize(("value", "torque"), [(0, 0), (1, 1)])
def test_the_startup_configuration_enables_the_torque(value: int, torque: int) -> None:
    bench = Bench()
    bench.write_all({x.startup_configuration: value})
    restart(bench)
    assert bench.read(x.torque_enable) == torque
    bench.run(0.5)
    assert bench.read(x.present_position) == pytest.approx(2048, abs=3)
    assert bench.write(x.startup_configuration, 4) == (ACCESS if torque else DATA_RANGE)


@pytest.mark.parametrize(("startup", "gain"), [(0, 640), (x.STARTUP_RESTORE, 1234)])
def test_a_backup_restores_the_gains_at_startup(startup: int, gain: int) -> None:
    bench = Bench()
    bench.write_all({x.position_p_gain: 1234, x.startup_configuration: startup})
    assert bench.read(x.backup_ready) == 0
    assert send(bench, Code.BACKUP, STORE) == 0
    assert bench.read(x.backup_ready) == 1
    restart(bench)
    assert (bench.read(x.position_p_gain), bench.read(x.backup_ready)) == (gain, 1)


def test_a_backup_restores_the_eeprom_and_reboots() -> None:
    bench = Bench()
    assert send(bench, Code.BACKUP, RESTORE) == FAIL, "there is no backup"
    bench.write_all({x.homing_offset: 55})
    assert send(bench, Code.BACKUP, STORE) == 0
    bench.write_all({x.homing_offset: 66, x.led: 1})
    assert send(bench, Code.BACKUP, RESTORE) == 0
    bench.run(REBOOT_S + 0.01)
    assert (bench.read(x.homing_offset), bench.read(x.led)) == (55, 0)


def test_a_backup_needs_its_key_and_limp_servos_and_new_firmware() -> None:
    bench = Bench()
    assert send(bench, Code.BACKUP, b"\x01CTRX") == INSTRUCTION
    bench.write_all({x.torque_enable: 1})
    assert send(bench, Code.BACKUP, STORE) == FAIL
    assert send(Bench(firmware=44), Code.BACKUP, STORE) == INSTRUCTION


def test_old_firmware_has_no_startup_configuration() -> None:
    bench = Bench(firmware=44)
    assert bench.write(x.startup_configuration, 1) == ACCESS


def test_clear_forgets_whole_turns_while_the_servo_is_at_rest() -> None:
    bench = Bench()
    bench.write_all({x.operating_mode: x.EXTENDED_POSITION_MODE})
    bench.turn_by_hand(8192)
    assert send(bench, Code.CLEAR, CLEAR) == 0
    assert bench.read(x.present_position) == pytest.approx(2048, abs=1)
    assert send(bench, Code.CLEAR, b"\x02" + CLEAR[1:]) == INSTRUCTION
    bench.write_all({x.torque_enable: 1, x.goal_position: 9000})
    bench.run(0.2)
    assert send(bench, Code.CLEAR, CLEAR) == FAIL
    assert send(Bench(firmware=41), Code.CLEAR, CLEAR) == INSTRUCTION


def test_the_sdk_clears_whole_turns() -> None:
    bench = Bench()
    bench.turn_by_hand(4096)
    assert handler.clearMultiTurn(bench.port, 1) == (sdk.COMM_SUCCESS, 0)
    assert bench.read(x.present_position) == pytest.approx(2048, abs=1)


class Pair:
    """Two servos with the IDs 1 and 2. Both servos have the secondary ID 2."""

    def __init__(self) -> None:
        self.bus = VirtualDynamixelBus.of(BenchPlant((1, 2)), {1: x.XL430_W250, 2: x.XL430_W250})
        for servo in self.bus.servos:
            servo.memory.put(x.secondary_id, 2)
        self.now_s = 1.0

    def sent(self, servo_id: int, code: int, parameters: bytes) -> list[int]:
        """Send an instruction and return the IDs of the servos that reply."""
        self.now_s += 0.1
        return [reply.data[4] for reply in self.bus.receive(packet(servo_id, code, parameters), self.now_s)]

    def values(self, register: Register) -> list[int]:
        return [servo.memory.get(register) for servo in self.bus.servos]


def test_a_servo_obeys_writes_to_its_secondary_id_without_a_reply() -> None:
    pair = Pair()
    assert pair.sent(2, Code.WRITE, b"\x41\0\x01") == [2]
    assert pair.values(x.led) == [1, 1]
    assert pair.sent(1, Code.WRITE, b"\x41\0\0") == [1]
    assert pair.values(x.led) == [0, 1]
    assert pair.sent(BROADCAST, Code.SYNC_WRITE, b"\x41\0\x01\0\x02\x01") == []
    assert pair.values(x.led) == [1, 1]
    assert pair.sent(2, Code.PING, b"") == [2]
    assert pair.sent(2, Code.READ, b"\0\0\x02\0") == [2]


def test_a_write_to_the_secondary_id_does_not_change_the_eeprom() -> None:
    pair = Pair()
    assert pair.sent(2, Code.WRITE, b"\x14\0\x07\0\0\0") == [2]
    assert pair.values(x.homing_offset) == [0, 7]


def test_a_secondary_id_above_252_is_disabled() -> None:
    pair = Pair()
    for servo in pair.bus.servos:
        servo.memory.put(x.secondary_id, 253)
    pair.sent(2, Code.WRITE, b"\x41\0\x01")
    assert pair.values(x.led) == [0, 1]


@pytest.mark.parametrize(("firmware", "option", "kept"), [(46, 0xFF, True), (46, 0x01, False), (41, 0xFF, False)])
def test_new_firmware_ignores_a_broadcast_factory_reset_of_everything(firmware: int, option: int, kept: bool) -> None:
    bench = Bench(firmware=firmware)
    bench.write_all({x.homing_offset: 9})
    assert send(bench, Code.FACTORY_RESET, bytes((option,)), BROADCAST) is None
    assert (bench.servo.memory.get(x.homing_offset) == 9) == kept


def test_a_servo_with_another_protocol_does_not_answer() -> None:
    bench = Bench()
    bench.write_all({x.protocol_type: 1})
    assert handler.ping(bench.port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.broadcastPing(bench.port)[0] == {}
    bench.servo.memory.put(x.protocol_type, 2)
    assert handler.ping(bench.port, 1)[1] == sdk.COMM_SUCCESS

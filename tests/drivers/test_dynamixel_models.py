"""Control tables of all Dynamixel models with protocol 2.0 compared with the official SDK, and mixed buses."""

import importlib.resources
import re
from collections.abc import Mapping

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import ServoRefused
from drivers.protocol import v2 as wire
from drivers.servos import x as x_series
from drivers.servos import xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import XL, X
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import Code, InstructionParser, status_packet
from sim_backend.packets.instructions import Instruction
from tests.drivers.cycles import exchange

MODELS = {model.name: model for series in (X, XL) for model in series.models}
pytest.importorskip("dynamixel_easy_sdk", reason="this version of the SDK has no control tables")
NOT_IN_SDK = (x_series.startup_configuration, x_series.backup_ready)
"""Registers that only the e-manual lists."""
IN_SDK = [model for model in MODELS.values() if model is not x_series.XC335_T332]
"""Models with a file in the SDK. The XC335-T332 has a file only in dynamixel_hardware_interface, with the table of the
XC330."""
TABLES = importlib.resources.files("dynamixel_easy_sdk") / "control_table"
NAMES = {
    "return_delay": "return_delay_time",
    "secondary_id": "secondary_shadow_id",
    "present_voltage": "present_input_voltage",
}


def sdk_table(file: str) -> dict[str, tuple[int, int]]:
    """Return address and size by register name from a model file of the SDK."""
    _, _, lines = (TABLES / file).read_text(encoding="utf-8").partition("[control table]")
    rows = re.findall(r"^(\d+)\t(\d+)\t(.+)$", lines, re.MULTILINE)
    return {re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_"): (int(a), int(size)) for a, size, name in rows}


def sdk_name(model: ServoModel) -> str:
    """Return the name of the SDK's model file. For an MX, the name contains the protocol of the firmware."""
    return model.name.removesuffix("-2.0").replace("-", "_")


def registers_of(model: ServoModel) -> tuple[Register, ...]:
    return x_series.registers(model) if isinstance(model, x_series.XModel) else xl320.REGISTERS


@pytest.mark.parametrize("model", IN_SDK, ids=lambda model: model.name)
def test_every_address_and_size_agrees_with_the_sdk(model: ServoModel) -> None:
    name = sdk_name(model)
    numbers = re.findall(
        r"^(\d+)\t(\S+)\.model", (TABLES / "dynamixel.model").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert (str(model.number), name) in numbers
    table = sdk_table(f"{name}.model")
    for register in (one for one in registers_of(model) if one not in NOT_IN_SDK):
        expected = table.get(register.name) or table[NAMES[register.name]]
        assert (register.address, register.size) == expected, register.name


@pytest.mark.parametrize("model", IN_SDK, ids=lambda model: model.name)
def test_only_indirect_registers_of_the_sdk_are_missing(model: ServoModel) -> None:
    ours = {(register.address, register.size) for register in registers_of(model)}
    theirs = sdk_table(f"{sdk_name(model)}.model")
    assert [name for name, place in theirs.items() if place not in ours and not name.startswith("indirect_")] == []


def test_every_model_has_one_series_and_the_blocks_of_a_series_differ() -> None:
    for model in MODELS.values():
        series = series_of(model)
        assert model in series.models
        sizes = [block.size for block in series.blocks]
        assert len(set(sizes)) == len(sizes)
        assert min(sizes) == sizes[0] == series.blocks[0].fields.size
        assert len({block.address + block.size for block in series.blocks}) == 1
    with pytest.raises(ValueError, match="other is not a supported servo model"):
        series_of(ServoModel("other", 1, "little", 4096, 12.0, 1.0, 1.0))


class Tables:
    """A port with servos that consist only of control tables."""

    name, baud = "tables", 1_000_000

    def __init__(self, servos: Mapping[int, ServoModel]) -> None:
        self.clock = SimulatedClock(1.0)
        self.memory = {i: bytearray(256) for i in servos}
        self.error = dict.fromkeys(servos, 0)
        self.sent: list[Instruction] = []
        self.silent: set[int] = set()
        self._models = dict(servos)
        self._parser = InstructionParser()
        self._input = b""
        for servo_id, model in servos.items():
            self.put(servo_id, series_of(model).max_torque, 600)
            self.put(servo_id, x_series.model_number, model.number)
            level = xl320.status_return_level if model is xl320.XL320 else x_series.status_return_level
            self.put(servo_id, level, 2)
            mode = xl320.control_mode if model is xl320.XL320 else x_series.operating_mode
            self.put(servo_id, mode, 2 if model is xl320.XL320 else 3)

    def put(self, servo_id: int, register: Register, value: int) -> None:
        end = register.address + register.size
        self.memory[servo_id][register.address : end] = register.encode(value, "little")

    def held(self, servo_id: int, register: Register) -> int:
        return register.decode(bytes(self.memory[servo_id][register.address :][: register.size]), "little")

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def discard_input(self) -> None:
        self._input = b""

    def close(self) -> None: ...

    def read(self, size: int, deadline_s: float) -> bytes:
        data, self._input = self._input[:size], self._input[size:]
        if len(data) < size:
            self.clock.sleep_until(deadline_s)
        return data

    def write(self, data: bytes) -> None:
        for instruction in self._parser.feed(data):
            self.sent.append(instruction)
            self._obey(instruction)

    def _obey(self, instruction: Instruction) -> None:
        p, number = instruction.parameters, lambda at: int.from_bytes(p[at : at + 2], "little")
        match instruction.code:
            case Code.PING:
                self._reply(
                    instruction.servo_id, self._models[instruction.servo_id].number.to_bytes(2, "little") + b"\1"
                )
            case Code.READ:
                self._read(instruction.servo_id, number(0), number(2))
            case Code.WRITE:
                self.memory[instruction.servo_id][number(0) : number(0) + len(p) - 2] = p[2:]
                self._reply(instruction.servo_id, b"")
            case Code.SYNC_WRITE:
                for at in range(4, len(p), number(2) + 1):
                    self.memory[p[at]][number(0) : number(0) + number(2)] = p[at + 1 : at + 1 + number(2)]
            case Code.SYNC_READ:
                for servo_id in p[4:]:
                    self._read(servo_id, number(0), number(2))
            case Code.BULK_READ:
                for at in range(0, len(p), 5):
                    self._read(p[at], number(at + 1), number(at + 3))

    def _read(self, servo_id: int, address: int, size: int) -> None:
        self._reply(servo_id, bytes(self.memory[servo_id][address : address + size]))

    def _reply(self, servo_id: int, data: bytes) -> None:
        if servo_id not in self.silent:
            self._input += status_packet(servo_id, self.error[servo_id], data)


def place_xl320(port: Tables, servo_id: int) -> None:
    port.put(servo_id, xl320.present_position, 700)
    port.put(servo_id, xl320.present_speed, -100)
    port.put(servo_id, xl320.present_load, -512)
    port.put(servo_id, xl320.present_voltage, 74)
    port.put(servo_id, xl320.present_temperature, 31)


XL320_STATE = ServoState(
    700,
    round(-100 * xl320.SPEED_UNIT_COUNTS_S),
    -512 / 1023,
    pytest.approx(7.4),
    31.0,  # type: ignore[arg-type]
)


@pytest.mark.parametrize("place", range(4))
def test_xl320_servos_are_read_by_plain_sync_reads(place: int) -> None:
    port = Tables({1: xl320.XL320, 2: xl320.XL320})
    bus = Bus(port, port.clock, {1: xl320.XL320, 2: xl320.XL320})
    place_xl320(port, 2)
    for _ in range(place):  # a servo with an open request is read with a different block
        port.silent = {1, 2}
        bus.read_states((1, 2), port.clock.now() + 0.005)
    port.silent, port.sent = set(), []
    assert bus.read_states((1, 2))[2] == XL320_STATE
    assert {instruction.code for instruction in port.sent} == {Code.SYNC_READ}


@pytest.mark.parametrize("series", (X, XL), ids=lambda series: series.name)
@pytest.mark.parametrize("velocity_counts_s", [-1, -10, -100000])
def test_a_negative_velocity_never_becomes_maximum_velocity(series: Series, velocity_counts_s: int) -> None:
    with pytest.raises(ValueError, match="nothing was written"):
        series.goal_of(series.models[0])(ServoGoal(512, velocity_counts_s))


def test_settings_goal_limit_and_torque_of_an_xl320() -> None:
    assert xl320.XL320.last_count == 1023
    port = Tables({3: xl320.XL320})
    bus = Bus(port, port.clock, {3: xl320.XL320}, position_p={3: 40})
    bus.identify(3, xl320.XL320)
    bus.write_goals({3: ServoGoal(512, 100)})
    assert bus.goal(3) == 512
    assert port.held(3, xl320.moving_speed) == -(-100 // xl320.SPEED_UNIT_COUNTS_S)
    with pytest.raises(ValueError, match="goal_position must be 0 to 1023"):
        bus.write_goals({3: ServoGoal(1024)})
    bus.limit_torque(3, 1.0)
    assert port.held(3, xl320.torque_limit) == 599  # a servo has the value 600 after a reset
    bus.torque_on(3)
    assert bus.torque_is_on(3)
    assert port.held(3, xl320.p_gain) == 40
    assert bus.torque_off((3,)) == []
    assert not bus.torque_is_on(3)
    port.put(3, xl320.control_mode, 1)
    with pytest.raises(ServoRefused, match=r"control mode 1: set it to 2 \(joint\)"):
        bus.identify(3, xl320.XL320)


MIXED = {1: x_series.XL430_W250, 2: xl320.XL320, 5: x_series.MX_28_2, 9: x_series.XC330_M288}
IDS = tuple(MIXED)


def mixed() -> tuple[Tables, Bus]:
    port = Tables(MIXED)
    place_xl320(port, 2)
    for servo_id in (1, 5, 9):
        port.put(servo_id, x_series.present_position, 100 * servo_id)
        # The last servo measures its current, and the others estimate their load
        port.put(servo_id, x_series.present_current, -50)
        port.put(servo_id, x_series.present_voltage, 120)
    return port, Bus(port, port.clock, MIXED)


def test_a_mixed_bus_uses_one_bulk_read_and_one_sync_write_per_series() -> None:
    port, bus = mixed()
    goals = {i: ServoGoal(100 + i) for i in IDS}
    states = exchange(bus, goals, IDS, port.clock.now() + 0.02)
    assert list(states) == list(IDS)
    assert states[2] == XL320_STATE
    for i in (1, 5, 9):
        current = pytest.approx(-0.05) if i == 9 else None
        assert states[i] == (100 * i, 0, 0.0, pytest.approx(12.0), 0.0, (), current)
    assert [i.code for i in port.sent] == [Code.BULK_READ, Code.SYNC_WRITE, Code.SYNC_WRITE]
    assert [bus.goal(i) for i in IDS] == [101, 102, 105, 109]
    assert bus.read_states(IDS) == states


@pytest.mark.parametrize("silent", IDS)
def test_a_silent_servo_on_a_mixed_bus_does_not_hide_others(silent: int) -> None:
    port, bus = mixed()
    port.silent = {silent}
    for _ in range(5):
        states = bus.read_states(IDS, port.clock.now() + 0.02)
        assert isinstance(states[silent], ServoFault)
        assert sum(isinstance(state, ServoState) for state in states.values()) == len(IDS) - 1
    port.silent = set()
    assert all(isinstance(state, ServoState) for state in bus.read_states(IDS).values())
    for account in bus.counters.servos.values():
        assert account.corrupt == account.late == 0


def test_alarms_on_a_mixed_bus_have_the_names_of_each_series() -> None:
    port, bus = mixed()
    port.error = dict.fromkeys(IDS, wire.ALERT)
    port.put(1, x_series.hardware_error_status, 1 << 5)
    port.put(2, xl320.hardware_error_status, 1 << 2)
    states = bus.read_states(IDS)
    assert [s.alarms for s in states.values() if isinstance(s, ServoState)] == [
        ("overload",),
        ("voltage",),
        ("hardware error",),
        ("hardware error",),
    ]


def test_torque_off_reaches_every_series() -> None:
    port, bus = mixed()
    for servo_id in IDS:
        bus.torque_on(servo_id)
    port.sent.clear()
    assert bus.torque_off(IDS) == []
    assert [i.code for i in port.sent[:2]] == [Code.SYNC_WRITE] * 2
    assert not any(bus.torque_is_on(i) for i in IDS)


def test_the_exchange_size_is_the_number_of_bytes_on_the_wire() -> None:
    port, bus = mixed()
    written: list[bytes] = []
    write, read = port.write, port.read
    port.write = lambda data: (written.append(data), write(data))[1]  # type: ignore[method-assign,func-returns-value]

    def listen(size: int, deadline_s: float) -> bytes:
        written.append(read(size, deadline_s))
        return written[-1]

    port.read = listen  # type: ignore[method-assign]
    goals = {i: ServoGoal(0) for i in IDS}
    exchange(bus, goals, IDS, port.clock.now() + 0.02)
    assert sum(map(len, written)) == bus.exchange_size(goals, IDS)


def test_no_input_remains_after_a_change_of_baud_rate() -> None:
    port, bus = mixed()
    bus.read_states(IDS)
    with bus.at_baud(57_600):
        assert port.baud == 57_600
        port._input += b"left over"
    assert port.baud == 1_000_000
    assert all(isinstance(s, ServoState) for s in bus.read_states(IDS, port.clock.now() + 0.02).values())
    assert bus.counters.noise == 0


def test_models_are_kept_at_a_different_baud_rate() -> None:
    """If the models were lost, the bus would read the block of the X series, which an XL-320 does not have."""
    clock = SimulatedClock()
    line = VirtualDynamixelBus.of(BenchPlant((1,)), {1: MODELS["xl430-w250"]})
    bus = Bus(VirtualPort(line, clock), clock, {1: MODELS["xl320"]})
    with bus.at_baud(57_600) as other:
        assert other.exchange_size({}, [1]) == bus.exchange_size({}, [1])

"""EEPROM writes over the real bus to virtual servos: which settings are written, and whether the lock is closed."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import PortLost, ServoError, ServoSilent
from drivers.eeprom import SILENCES, TRIES, Change, EepromError, eeprom, update
from drivers.servos import ax_mx as dxl
from drivers.servos import sts, xl320
from drivers.servos.register import Register
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.drivers.fault_lines import CYCLES

LOCK = sts.lock
READ, WRITE = 0x02, 0x03
EEPROM_END = sts.torque_enable.address


class RecordingPort(VirtualPort):
    """A port that records all write instructions. ``before_write`` can inject a fault before each packet."""

    def __init__(self, servos: VirtualBus, clock: SimulatedClock) -> None:
        super().__init__(servos, clock)
        self.packets: list[bytes] = []
        self.before_write: Callable[[int], None] = lambda number: None
        self.losing = self.garbling = False

    def write(self, data: bytes) -> None:
        self.before_write(len(self.packets))
        self.packets.append(data)
        super().write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        data = super().read(size, deadline_s)
        if self.garbling and data:
            data = data[:-1] + bytes((data[-1] ^ 0xFF,))
        return b"" if self.losing else data

    @property
    def written(self) -> list[int]:
        """Return the addresses of all write instructions, in order."""
        return [packet[5] for packet in self.packets if packet[4] == WRITE]

    @property
    def wear(self) -> list[int]:
        """Return the addresses of all writes that wear out the EEPROM."""
        return [address for address in self.written if address < EEPROM_END]


@dataclass
class Line:
    """A bus with two virtual servos, IDs 1 and 2."""

    clock: SimulatedClock = field(default_factory=lambda: SimulatedClock(10.0))
    servos: VirtualBus = field(default_factory=lambda: VirtualBus.of(BenchPlant((1, 2))))

    def __post_init__(self) -> None:
        self.port = RecordingPort(self.servos, self.clock)
        bus: Bus = Bus(self.port, self.clock)
        self.bus = bus
        self.first = self.servos.servo(1)

    def held(self, register: Register) -> int:
        return self.first.memory.get(register)


def test_nothing_is_written_when_nothing_differs() -> None:
    line = Line()
    values = {r: line.held(r) for r in (sts.position_p, sts.max_position, sts.homing_offset, sts.servo_id)}
    assert update(line.bus, 1, LOCK, values) == ()
    assert line.port.written == []


def test_only_different_values_are_written_and_they_persist_with_the_lock_closed() -> None:
    line = Line()
    values = {sts.position_p: 16, sts.position_d: 32, sts.homing_offset: -85}
    changes = update(line.bus, 1, LOCK, values)
    assert changes == (Change(sts.position_p, 32, 16), Change(sts.homing_offset, 0, -85))
    assert line.port.written == [sts.lock.address, 21, 31, sts.lock.address]
    assert line.held(sts.lock) == 1
    line.first.power_cycle()
    assert {register: line.held(register) for register in values} == values
    assert update(line.bus, 1, LOCK, values) == ()


def test_settings_can_be_written_one_by_one() -> None:
    line = Line()
    with eeprom(line.bus, 1, LOCK) as memory:
        memory.write(sts.max_torque, memory.read(sts.max_torque) // 2)
        assert line.held(sts.lock) == 0
    assert (line.held(sts.max_torque), line.held(sts.lock)) == (500, 1)


def test_a_lock_left_open_is_closed() -> None:
    line = Line()
    line.first.memory.put(sts.lock, 0)
    assert update(line.bus, 1, LOCK, {sts.position_p: 32}) == ()
    assert line.held(sts.lock) == 1


@pytest.mark.parametrize(
    ("register", "value", "text"),
    [
        (sts.homing_offset, 2114, "homing_offset must be -2047 to 2047, not 2114"),
        (sts.model_number, 1, "model_number is not a writable EEPROM setting"),
        (sts.goal_position, 1, "goal_position is not a writable EEPROM setting"),
        (sts.servo_id, 254, "id must be 0 to 253"),
        (sts.baud_rate, 1, "baud_rate cannot be written, because the servo would no longer respond on this bus"),
        (
            dxl.status_return_level,
            0,
            "status_return_level 0 cannot be written, because the servo would no longer respond to reads",
        ),
        (
            xl320.status_return_level,
            0,
            "status_return_level 0 cannot be written, because the servo would no longer respond to reads",
        ),
    ],
)
def test_an_impossible_write_is_refused_before_sending(register: Register, value: int, text: str) -> None:
    line = Line()
    with pytest.raises(ValueError, match=f"{text}.*nothing was written"):
        update(line.bus, 1, LOCK, {sts.position_p: 16, register: value})
    assert line.port.packets == []


@pytest.mark.parametrize("model", [dxl.AX_12A, dxl.MX_28], ids=lambda model: model.name)
def test_acknowledgments_can_be_switched_off_and_on(model: dxl.AxMxModel) -> None:
    clock = SimulatedClock(10.0)
    servos = VirtualBus.of(BenchPlant((1, 2)), model)
    bus = Bus(VirtualPort(servos, clock), clock, dict.fromkeys((1, 2), model))
    level = dxl.status_return_level
    with pytest.raises(ValueError, match="nothing was written"), eeprom(bus, 1, None) as memory:
        memory.write(level, 0)
    assert update(bus, 1, None, {level: 1}) == (Change(level, 2, 1),)
    assert update(bus, 1, None, {level: 2}) == (Change(level, 1, 2),)
    assert servos.servo(1).memory.get(level) == 2


def test_nothing_is_written_while_torque_is_enabled() -> None:
    line = Line()
    line.bus.torque_on(1)
    with pytest.raises(
        EepromError, match=r"servo 1: position_p \(register 21\) was not written: the torque of the servo is enabled"
    ):
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert line.port.wear == []
    assert line.held(sts.lock) == 1


def test_without_a_lock_register_only_torque_prevents_writes() -> None:
    line = Line()
    assert update(line.bus, 1, None, {sts.position_p: 16}) == (Change(sts.position_p, 32, 16),)
    assert line.port.written == [21]


def test_a_value_that_the_servo_does_not_keep_is_reported() -> None:
    line = Line()
    memory = line.first.memory
    line.port.before_write = lambda number: memory.put(sts.position_p, 32)
    with pytest.raises(EepromError, match=r"servo 1: position_p \(register 21\) is still 32, not 16") as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert (caught.value.servo_id, caught.value.register) == (1, sts.position_p)
    assert line.held(sts.lock) == 1


def test_a_lost_reply_does_not_cause_a_second_write() -> None:
    line = Line()
    line.port.before_write = lambda number: line.servos.faults.corrupt_next(1) if number == 4 else None
    assert update(line.bus, 1, LOCK, {sts.position_p: 16}) == (Change(sts.position_p, 32, 16),)
    assert line.port.packets[4][4:6] == bytes((WRITE, 21))
    assert line.port.wear == [21]
    assert line.held(sts.lock) == 1


def test_the_id_is_written_last_and_the_lock_is_closed_with_the_new_id() -> None:
    line = Line()
    changes = update(line.bus, 1, LOCK, {sts.servo_id: 9, sts.position_p: 16})
    assert [change.register for change in changes] == [sts.position_p, sts.servo_id]
    assert (line.first.servo_id, line.held(sts.lock)) == (9, 1)


def test_an_id_in_use_is_refused() -> None:
    line = Line()
    with pytest.raises(
        EepromError, match=r"servo 1: id \(register 5\) cannot be changed to 2: another servo has this ID"
    ):
        update(line.bus, 1, LOCK, {sts.servo_id: 2})
    assert line.port.wear == []


@pytest.mark.parametrize("heard", range(SILENCES))
def test_an_id_is_in_use_if_any_reply_arrives(heard: int) -> None:
    """Two servos with one ID cannot be distinguished over the bus. The first packet is the read of the old ID."""
    line = Line()

    def meddle(number: int) -> None:
        line.port.losing = 0 < number <= SILENCES and number != 1 + heard

    line.port.before_write = meddle
    with pytest.raises(EepromError, match="cannot be changed to 2: another servo has this ID"):
        update(line.bus, 1, LOCK, {sts.servo_id: 2})
    assert [servo.servo_id for servo in line.servos.servos] == [1, 2]


def test_an_id_is_in_use_if_a_corrupt_reply_arrives() -> None:
    line = Line()

    def meddle(number: int) -> None:
        line.port.losing, line.port.garbling = 0 < number < SILENCES, number == SILENCES

    line.port.before_write = meddle
    with pytest.raises(EepromError, match="cannot be changed to 2: another servo has this ID"):
        update(line.bus, 1, LOCK, {sts.servo_id: 2})


@pytest.mark.parametrize("fault", ["lost", "garbled"])
@pytest.mark.parametrize("length", range(1, TRIES))
@pytest.mark.parametrize("at", range(10))
def test_reads_are_repeated(at: int, length: int, fault: str) -> None:
    """``length`` consecutive replies to requests about the setting, the torque or the lock are lost. The setting is
    written only once."""
    line = Line()

    def meddle(number: int) -> None:
        failing = at <= number < at + length
        line.port.losing, line.port.garbling = failing and fault == "lost", failing and fault == "garbled"

    line.port.before_write = meddle
    assert update(line.bus, 1, LOCK, {sts.position_p: 16}) == (Change(sts.position_p, 32, 16),)
    assert line.port.wear == [21]
    assert line.held(sts.lock) == 1


def test_an_unreadable_torque_state_names_the_setting() -> None:
    line = Line()
    line.port.before_write = lambda number: line.servos.faults.silence(1) if number == 1 else None
    with pytest.raises(
        EepromError, match=r"servo 1: position_p \(register 21\) was not written.* torque .*not respond"
    ) as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert (caught.value.servo_id, caught.value.register) == (1, sts.position_p)
    assert isinstance(caught.value.__cause__, ServoSilent)
    assert line.port.written == []


def test_a_setting_that_cannot_be_read_back_may_have_changed() -> None:
    line = Line()
    line.port.before_write = lambda number: line.servos.faults.silence(1) if number == 5 else None
    with pytest.raises(
        EepromError, match=r"servo 1: position_p \(register 21\) may have changed to 16, but .*not respond"
    ):
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert line.held(sts.position_p) == 16


def test_a_port_lost_before_the_read_back_adds_a_note() -> None:
    line = Line()
    line.port.before_write = lambda number: line.port.unplug() if number == 5 else None
    with pytest.raises(PortLost) as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert "servo 1: position_p (register 21) may have changed to 16" in caught.value.__notes__
    assert line.held(sts.position_p) == 16


@pytest.mark.parametrize("second", [sts.homing_offset, sts.lock])
def test_a_failure_lists_earlier_changes(second: Register) -> None:
    """Either the second of two settings is not accepted, or the lock is not closed after the only setting."""
    line = Line()
    begun = 1 if second is sts.lock else 2

    def meddle(number: int) -> None:
        if len(line.port.wear) >= begun:
            line.first.memory.put(second, 0)

    line.port.before_write = meddle
    with pytest.raises(EepromError, match=second.name) as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16} | ({second: 5} if begun == 2 else {}))
    assert "written before this error: position_p 32 to 16" in caught.value.__notes__


@pytest.mark.parametrize("number", range(8))
def test_a_servo_that_becomes_silent_is_named(number: int) -> None:
    line = Line()
    line.port.before_write = lambda n: line.servos.faults.silence(1) if n == number else None
    with pytest.raises(ServoError, match="servo 1: ") as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert caught.value.servo_id == 1
    opened = line.held(sts.lock) == 0
    # A caller that catches only the first error also learns that the lock is open.
    assert not opened or "lock (register 55)" in str(caught.value) + "".join(getattr(caught.value, "__notes__", []))


@pytest.mark.parametrize("number", range(9))
def test_a_lost_port_raises_port_lost(number: int) -> None:
    line = Line()
    line.port.before_write = lambda n: line.port.unplug() if n == number else None
    with pytest.raises(PortLost):
        update(line.bus, 1, LOCK, {sts.position_p: 16})


@pytest.mark.parametrize("number", range(24))
def test_settings_survive_a_reset_between_writes(number: int) -> None:
    """A reset closes the lock. A value that is written after a reset can be read back, but is lost at power-off."""
    line = Line()
    line.port.before_write = lambda n: line.first.power_cycle() if n == number else None
    values = {sts.position_p: 16, sts.position_d: 20, sts.homing_offset: -85}
    update(line.bus, 1, LOCK, values)
    assert line.held(sts.lock) == 1
    line.first.power_cycle()
    assert {register: line.held(register) for register in values} == values


def test_a_servo_that_is_reset_repeatedly_is_named() -> None:
    """Each reset happens just after the lock was read as open."""
    line = Line()

    def meddle(number: int) -> None:
        if number and line.port.packets[-1][4:6] == bytes((READ, LOCK.address)):
            line.first.memory.put(LOCK, 1)

    line.port.before_write = meddle
    with pytest.raises(
        EepromError, match=r"servo 1: position_p .* may not have been saved: the servo was reset repeatedly"
    ):
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert line.held(LOCK) == 1


class Stumble(BaseException):
    """An interrupt that is not an Exception, like Ctrl-C."""


def test_an_interrupt_while_the_lock_is_closed_after_an_error_is_raised() -> None:
    line = Line()

    def stumble(number: int) -> None:
        line.port.before_write = lambda number: None
        raise Stumble

    with pytest.raises(Stumble) as caught, eeprom(line.bus, 1, LOCK) as memory:
        memory.write(sts.position_p, 16)
        line.port.before_write = stumble
        raise EepromError(1, sts.position_p, "is wrong")
    assert isinstance(caught.value.__context__, EepromError) and line.held(LOCK) == 1


@pytest.mark.parametrize("begun", range(1, 9))
@pytest.mark.parametrize("times", range(1, TRIES + 2))
def test_repeated_interrupts_leave_the_lock_closed_or_add_a_note(begun: int, times: int) -> None:
    """Ctrl-C arrives before packet ``begun`` and before each of the following packets."""
    line = Line()

    def stumble(number: int) -> None:
        if number >= begun and len(stumbles) < times:
            stumbles.append(number)
            raise Stumble

    stumbles: list[int] = []
    line.port.before_write = stumble
    with pytest.raises(Stumble) as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    notes = "".join(getattr(caught.value, "__notes__", []))
    assert line.held(LOCK) == 1 or (times > TRIES and "the EEPROM may be left unlocked" in notes)


@pytest.mark.soak
@settings(max_examples=CYCLES // 10)
@given(
    st.integers(0, 32),
    st.integers(1, TRIES - 1),
    st.sampled_from(("not heard", "reply lost", "reply corrupt")),
    st.none() | st.integers(0, 4),
)
def test_the_lock_is_closed_however_the_block_ends(at: int, length: int, fault: str, stumble: int | None) -> None:
    """From packet ``at`` on, ``length`` exchanges fail. The caller raises an error after ``stumble`` writes."""
    line = Line()

    def meddle(number: int) -> None:
        failing = at <= number < at + length
        line.port.losing = failing and fault == "reply lost"
        line.port.garbling = failing and fault == "reply corrupt"
        for servo_id in (1, 9):
            line.servos.faults.restore(servo_id)
            if failing and fault == "not heard":
                line.servos.faults.silence(servo_id)

    line.port.before_write = meddle
    steps = ((sts.position_p, 16), (sts.homing_offset, -2047), (sts.max_torque, 700), (sts.servo_id, 9))
    ended: BaseException | None = None
    try:
        with eeprom(line.bus, 1, LOCK) as memory:
            for number, (register, value) in enumerate(steps):
                if number == stumble:
                    raise Stumble
                memory.write(register, value)
    except (ServoError, Stumble) as error:
        ended = error
    assert line.held(sts.lock) == 1
    if ended is None:
        line.first.power_cycle()
        assert [line.held(register) for register, _ in steps] == [value for _, value in steps]
    unheard = length if fault == "not heard" else 0  # A write that does not arrive causes no wear, and is repeated.
    assert len(line.port.wear) <= len(steps) + unheard


@pytest.mark.parametrize("number", range(14))
def test_an_interrupt_at_any_packet_leaves_the_lock_closed(number: int) -> None:
    """The interrupted packets include the one that closes the lock."""
    line = Line()

    def interrupt(n: int) -> None:
        if n == number:
            line.port.before_write = lambda n: None
            raise KeyboardInterrupt

    line.port.before_write = interrupt
    with pytest.raises(KeyboardInterrupt):
        update(line.bus, 1, LOCK, {sts.position_p: 16, sts.position_d: 20})
    assert line.held(sts.lock) == 1


def test_an_error_of_the_caller_is_raised_and_the_lock_is_closed() -> None:
    line = Line()
    with pytest.raises(KeyError, match="mine"), eeprom(line.bus, 1, LOCK) as memory:
        memory.write(sts.position_p, 16)
        raise KeyError("mine")
    assert line.held(sts.lock) == 1


def test_a_silent_servo_is_reported_quickly() -> None:
    line = Line()
    line.servos.faults.silence(1)
    with pytest.raises(
        EepromError, match=r"servo 1: position_p .* cannot be read: the servo does not respond"
    ) as caught:
        update(line.bus, 1, LOCK, {sts.position_p: 16})
    assert isinstance(caught.value.__cause__, ServoSilent)
    assert len(line.port.packets) <= ATTEMPTS + 2

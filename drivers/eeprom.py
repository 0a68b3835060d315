"""Write settings to a servo's EEPROM only if they differ, read them back, and lock the EEPROM again.

    with eeprom(bus, 3, sts.lock) as memory:
        memory.write(sts.max_torque, 800)

The lock is opened before the first necessary write, and closed when the ``with`` block ends for any reason.
Every write is verified by a read rather than by its reply, so that a lost reply does not cause a second EEPROM write. A
write that did not reach the servo is repeated.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.driver_errors import DriverError, PortLost, ServoCorrupt, ServoError, ServoSilent
from drivers.servos.register import Access, Register

LARGEST_ID = 253
"""Largest ID of Feetech servos. The largest ID of Dynamixel servos is 252. 254 is the broadcast ID."""
LEAVES_THE_LINE = frozenset({"baud_rate", "protocol_type"})
"""Settings that cannot be read back after the write, because the servo can no longer be reached on this bus."""
ANSWERS_NO_READ = {"status_return_level": 0}
"""Values that make a Dynamixel servo respond only to pings. Such a value cannot be read back or reset."""
TRIES = 3
"""Number of attempts to write, to close the lock, and to find a servo with a new ID. These attempts do not wear out the
EEPROM.
"""
HOLDS = "the torque of the servo is enabled. Support the arm, then disable the torque"
"""Reason why a setting is not written."""
OPEN, CLOSED = 0, 1
"""Values of the lock register."""
SILENCES = 8
"""Number of consecutive requests without a reply after which an ID is considered free. On a bus that loses 9 % of the
packets in each direction, one request in six fails by chance. All of these requests fail by chance once in a million
cases."""


class EepromError(ServoError):
    """Error of the setting ``register``, which could not be written."""

    def __init__(self, servo_id: int, register: Register, text: str) -> None:
        super().__init__(servo_id, f"{register.name} (register {register.address}) {text}")
        self.register = register


@dataclass(frozen=True, slots=True)
class Change:
    """EEPROM setting that was written, with its old and new values."""

    register: Register
    old: int
    new: int

    def __str__(self) -> str:
        return f"{self.register.name} {self.old} to {self.new}"


@dataclass(slots=True)
class Eeprom:
    """Settings of one servo. When the ID setting is written, ``servo_id`` changes as well."""

    bus: Bus
    servo_id: int
    lock: Register | None
    changes: list[Change] = field(default_factory=list)
    _touched: bool = False
    _becoming: tuple[Register, int] | None = None
    """ID register and new ID while a new ID is being written; otherwise None. If this write is interrupted, the servo
    may have either ID."""

    def read(self, register: Register) -> int:
        """Read a setting."""
        return self._ask(partial(self.bus.read, self.servo_id, register), register, "cannot be read")

    def write(self, register: Register, value: int) -> None:
        """Write a setting, unless the servo already holds this value."""
        _check(register, value)
        old = self.read(register)
        if old == value:
            return
        if register.name == "id":
            self._refuse_taken(register, value)
        self.unlock(register)
        try:
            self._put(register, value)
        except PortLost as error:
            error.add_note(str(EepromError(self.servo_id, register, f"may have changed to {value}")))
            raise
        self.changes.append(Change(register, old, value))

    def write_unread(self, register: Register, value: int) -> None:
        """Write a setting that makes the servo unreachable on this bus.

        The caller must find the servo again and set ``bus``.
        """
        register.check(value)
        self.unlock(register)
        self._try_write(register, value)

    def _put(self, register: Register, value: int) -> None:
        """Write a setting and verify it. Repeat the write only if a servo reset has closed the lock."""
        for _ in range(TRIES):
            self._put_once(register, value)
            if self.lock is None or self._is_open(self.lock, register):
                return
            self._turn(self.lock, OPEN)
        raise EepromError(
            self.servo_id, register, "may not have been saved: the servo was reset repeatedly. Check its power"
        )

    def _put_once(self, register: Register, value: int) -> None:
        """Write a setting and read it back. Repeat a write that was not acknowledged and has changed nothing."""
        for _ in range(TRIES):
            self._becoming = (register, value) if register.name == "id" else None
            failure = self._try_write(register, value)
            held = self._read_back(register, value)
            if held == value:
                return
            if not isinstance(failure, ServoSilent | ServoCorrupt):
                break
        raise EepromError(self.servo_id, register, f"is still {held}, not {value}: {_why(failure)}") from failure

    def _read_back(self, register: Register, value: int) -> int:
        """Return the value that a servo stores after a write. The servo may have a new ID."""
        if register.name != "id":
            read = partial(self.bus.read, self.servo_id, register)
            return self._ask(read, register, f"may have changed to {value}, but cannot be read back")
        held = self._follow(register, value)
        self._becoming = None
        return held

    def _is_open(self, lock: Register, register: Register) -> bool:
        """Return whether the lock is still open after a write. If the lock has closed, the value is lost at
        power-off."""
        read = partial(self.bus.read, self.servo_id, lock)
        return self._ask(read, register, "was written, but may not have been saved") == OPEN

    def _ask(self, question: Callable[[], int], register: Register, failed: str) -> int:
        """Return the result of a request with retries. Raises EepromError with the message ``failed``."""
        try:
            return retry(question)
        except ServoError as error:
            raise EepromError(self.servo_id, register, f"{failed}: {_why(error)}") from error

    def _refuse_taken(self, register: Register, new_id: int) -> None:
        """Raise EepromError if another servo has the new ID. Servos with the same ID cannot be told apart on a bus."""
        if any(self._stirs(new_id, register) for _ in range(SILENCES)):
            raise EepromError(self.servo_id, register, f"cannot be changed to {new_id}: another servo has this ID")

    def _stirs(self, servo_id: int, register: Register) -> bool:
        try:
            self.bus.read(servo_id, register)
        except ServoSilent:
            return False
        except ServoError:
            pass  # at least one servo replies
        return True

    def _follow(self, register: Register, new_id: int) -> int:
        """Find the servo after writing its ID, and return its actual ID, which is either the new or the old one."""
        for candidate in (new_id, self.servo_id) * TRIES:
            try:
                held = self.bus.read(candidate, register)
            except ServoError:
                continue
            self.servo_id = candidate
            return held
        raise EepromError(
            self.servo_id,
            register,
            f"was changed to {new_id}, but the servo responds to neither its new nor its old ID: check its power",
        )

    def unlock(self, register: Register) -> None:
        """Open the lock before the first write. Raises EepromError if torque is enabled."""
        if self._touched:
            return
        torque_is_on = partial(self.bus.torque_is_on, self.servo_id)
        if self._ask(torque_is_on, register, "was not written because the servo's torque state cannot be read"):
            raise EepromError(self.servo_id, register, f"was not written: {HOLDS}")
        self._touched = True  # set before the write, because the reply to the write may be lost
        if self.lock is not None:
            self._turn(self.lock, OPEN)

    def close(self) -> None:
        """Close the lock if it is open, even if another program left it open."""
        if self.lock is None:
            return
        if self._becoming is not None:
            with suppress(ServoError):
                self._follow(*self._becoming)
        closed = self._stands(self.lock, CLOSED)
        if not closed and (self._touched or self._stands(self.lock, OPEN)):
            self._turn(self.lock, CLOSED)

    def _turn(self, lock: Register, position: int) -> None:
        failure: ServoError | None = None
        for _ in range(TRIES):
            failure = self._try_write(lock, position) or failure
            if self._stands(lock, position):
                return
        state = "closed" if position == CLOSED else "open"
        raise EepromError(self.servo_id, lock, f"cannot be set to {state}: {_why(failure)}") from failure

    def _stands(self, lock: Register, position: int) -> bool:
        try:
            return self.bus.read(self.servo_id, lock) == position
        except ServoError:
            return False

    def _try_write(self, register: Register, value: int) -> ServoError | None:
        try:
            self.bus.write(self.servo_id, register, value)
        except ServoError as error:
            return error
        return None


@contextmanager
def eeprom(bus: Bus, servo_id: int, lock: Register | None) -> Iterator[Eeprom]:
    """Return a context manager for writing the settings of one servo.

    If the block raises an exception and the lock cannot be closed, a note is added to the exception. If an interrupt
    such as a second Ctrl-C arrives while the lock is being closed, closing is retried a few times.

    Raises:
        EepromError: A setting cannot be read or written. The message specifies the servo and the register.
        PortLost: The port has disappeared.
    """
    memory = Eeprom(bus, servo_id, lock)
    try:
        yield memory
    except BaseException as error:
        _close_after(memory, error)
        raise
    try:
        memory.close()
    except DriverError:
        raise
    except BaseException as error:  # an interrupt while the lock was being closed
        _close_after(memory, error)
        raise


def _close_after(memory: Eeprom, error: BaseException) -> None:
    interrupt: BaseException | None = None
    why = f"closing its lock was interrupted repeatedly (servo {memory.servo_id})"
    for _ in range(TRIES):
        try:
            memory.close()
            why = ""
            break
        except DriverError as second:
            why = str(second)
            break
        except BaseException as again:
            interrupt = again
    if why:
        error.add_note(f"the EEPROM may be left unlocked: {why}")
    if interrupt is not None and isinstance(error, Exception):  # the caller may catch an Exception and continue
        raise interrupt


def update(bus: Bus, servo_id: int, lock: Register | None, values: Mapping[Register, int]) -> tuple[Change, ...]:
    """Write all settings that differ from ``values`` and return the changes. The ID is written last.

    If an exception is raised, a note about each earlier change is added to it.
    """
    for register, value in values.items():
        _check(register, value)
    changes: list[Change] = []
    try:
        with eeprom(bus, servo_id, lock) as memory:
            changes = memory.changes
            for register in sorted(values, key=lambda r: (r.name == "id", r.address)):
                memory.write(register, values[register])
    except BaseException as error:
        add_notes(error, changes)
        raise
    return tuple(changes)


def add_notes(error: BaseException, changes: Iterable[Change]) -> None:
    """Add a note to an exception about each change that was written before the exception."""
    for change in changes:
        error.add_note(f"written before this error: {change}")


def _check(register: Register, value: int) -> None:
    """Raise ValueError if the register or the value can never be written."""
    if register.access is Access.READ or not register.persistent:
        raise ValueError(f"{register.name} is not a writable EEPROM setting: nothing was written")
    if register.name in LEAVES_THE_LINE:
        raise ValueError(
            f"{register.name} cannot be written, because the servo would no longer respond on this bus and the new "
            "value could not be verified: nothing was written"
        )
    if ANSWERS_NO_READ.get(register.name) == value:
        raise ValueError(
            f"{register.name} {value} cannot be written, because the servo would no longer respond to reads and the "
            "value could not be verified: nothing was written"
        )
    if register.name == "id" and value > LARGEST_ID:
        raise ValueError(f"id must be 0 to {LARGEST_ID}, not {value}: nothing was written")
    register.check(value)


def _why(failure: ServoError | None) -> str:
    return "the servo did not accept the value" if failure is None else f"the servo {failure.text}"

"""Settings that outlive power-off: written only where they differ, read back, and locked again.

    with eeprom(bus, 3, sts.lock) as memory:
        memory.write(sts.max_torque, 800)

Within the scope the lock is opened before the first write that is needed, and not at all if none is.
However the scope ends, the lock is closed on the way out. Whether a write or the lock took is decided
by reading, never by the reply to the write: a reply that was lost costs no second write of the EEPROM.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.errors import DriverError, PortLost, ServoError, ServoSilent
from drivers.servos.register import Access, Register

LARGEST_ID = 253
"""Of Feetech; Dynamixel allows one less. 254 calls everybody."""
LEAVES_THE_LINE = frozenset({"baud_rate", "protocol_type"})
"""Settings after which the servo could neither be read back nor locked."""
ANSWERS_NO_READ = {"status_return_level": 0}
"""At this value a Dynamixel answers a ping and nothing else: it could not be read back either, nor set back."""
TRIES = 3
"""How often the lock is written (RAM), or closed after interrupts, and a servo with a new ID is looked for: none of it
wears.
"""
HOLDS = "the servo holds torque, switch it off first; support the arm, because what it holds falls"
"""Why no setting is written."""
OPEN, CLOSED = 0, 1
"""What the lock holds."""
SILENCES = 8
"""So many questions to an ID must stay unanswered before it counts as free. On a line that loses 9 % each way one in
six stays so by chance, and all of them once in a million."""


class EepromError(ServoError):
    """A setting that could not be written; ``register`` tells which."""

    def __init__(self, servo_id: int, register: Register, text: str) -> None:
        super().__init__(servo_id, f"{register.name} (register {register.address}) {text}")
        self.register = register


@dataclass(frozen=True, slots=True)
class Change:
    """One setting that was written."""

    register: Register
    old: int
    new: int

    def __str__(self) -> str:
        return f"{self.register.name} {self.old} to {self.new}"


@dataclass(slots=True)
class Eeprom:
    """One servo's settings within the scope. ``servo_id`` follows when the ID itself is written."""

    bus: Bus
    servo_id: int
    lock: Register | None
    changes: list[Change] = field(default_factory=list)
    _touched: bool = False
    _becoming: tuple[Register, int] | None = None
    """The ID that is being written: whoever is interrupted meanwhile finds the servo by the one or the other."""

    def read(self, register: Register) -> int:
        """What the servo holds."""
        return self._ask(partial(self.bus.read, self.servo_id, register), register, "cannot be read")

    def write(self, register: Register, value: int) -> None:
        """Make the servo hold ``value``; nothing is sent but reads if it does already."""
        _check(register, value)
        old = self.read(register)
        if old == value:
            return
        if register.name == "id":
            self._refuse_taken(register, value)
        self._unlock(register)
        try:
            self._put(register, value)
        except PortLost as error:
            error.add_note(str(EepromError(self.servo_id, register, f"has perhaps become {value}")))
            raise
        self.changes.append(Change(register, old, value))

    def write_unread(self, register: Register, value: int) -> None:
        """Unlock and write, once, what takes the servo off this line. The caller finds it and sets ``bus``."""
        register.check(value)
        self._unlock(register)
        self._try_write(register, value)

    def _put(self, register: Register, value: int) -> None:
        """Write it once, and look. Once more only where the servo was reset meanwhile: that closes the lock."""
        for _ in range(TRIES):
            self._put_once(register, value)
            if self.lock is None or self._is_open(self.lock, register):
                return
            self._turn(self.lock, OPEN)
        raise EepromError(self.servo_id, register, "is perhaps not saved: the servo loses its power again and again")

    def _put_once(self, register: Register, value: int) -> None:
        self._becoming = (register, value) if register.name == "id" else None
        failure = self._try_write(register, value)
        if register.name == "id":
            held = self._follow(register, value)
            self._becoming = None
        else:
            read = partial(self.bus.read, self.servo_id, register)
            held = self._ask(read, register, f"has perhaps become {value}: it cannot be read back")
        if held != value:
            raise EepromError(self.servo_id, register, f"stays {held}, not {value}: {_why(failure)}") from failure

    def _is_open(self, lock: Register, register: Register) -> bool:
        """Whether what has just been written was written with the lock open: only that outlives power-off."""
        read = partial(self.bus.read, self.servo_id, lock)
        return self._ask(read, register, "was written, and is perhaps not saved") == OPEN

    def _ask(self, question: Callable[[], int], register: Register, failed: str) -> int:
        """The answer; EepromError of ``register`` that tells what ``failed``. One lost packet is not the end."""
        try:
            return retry(question)
        except ServoError as error:
            raise EepromError(self.servo_id, register, f"{failed}: {_why(error)}") from error

    def _refuse_taken(self, register: Register, new_id: int) -> None:
        """Two servos with one ID can neither be told apart nor be parted again over the wire."""
        if any(self._stirs(new_id, register) for _ in range(SILENCES)):
            raise EepromError(self.servo_id, register, f"must not become {new_id}: another servo answers to that")

    def _stirs(self, servo_id: int, register: Register) -> bool:
        try:
            self.bus.read(servo_id, register)
        except ServoSilent:
            return False
        except ServoError:
            pass  # somebody is there, and perhaps two already
        return True

    def _follow(self, register: Register, new_id: int) -> int:
        """The ID that the servo answers to after its ID was written, the new one or still the old one."""
        for candidate in (new_id, self.servo_id) * TRIES:
            try:
                held = self.bus.read(candidate, register)
            except ServoError:
                continue
            self.servo_id = candidate
            return held
        raise EepromError(self.servo_id, register, f"was to become {new_id}: now it answers to neither")

    def _unlock(self, register: Register) -> None:
        """Open the lock, once, for ``register`` is to be written."""
        if self._touched:
            return
        torque_is_on = partial(self.bus.torque_is_on, self.servo_id)
        if self._ask(torque_is_on, register, "is not written, for the servo's torque cannot be read"):
            raise EepromError(self.servo_id, register, f"is not written: {HOLDS}")
        self._touched = True  # before it is: the reply to the write may be what gets lost
        if self.lock is not None:
            self._turn(self.lock, OPEN)

    def close(self) -> None:
        """Close the lock if it is open. One that somebody else left open is closed too, if it can be read."""
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
        raise EepromError(self.servo_id, lock, f"does not become {state}: {_why(failure)}") from failure

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
    """The scope. Raises EepromError with servo and register, PortLost once the line is gone.

    If it ends by an exception and the lock cannot be closed either, the exception carries a note of that. An interrupt
    while it is being closed, a second Ctrl-C, does not leave it open: it is closed from the beginning, a few times.
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
    except BaseException as error:  # an interrupt, while it was being closed
        _close_after(memory, error)
        raise


def _close_after(memory: Eeprom, error: BaseException) -> None:
    interrupt: BaseException | None = None
    why = f"closing it was interrupted again and again (servo {memory.servo_id})"
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
    if interrupt is not None and isinstance(error, Exception):  # which somebody may catch, and go on
        raise interrupt


def update(bus: Bus, servo_id: int, lock: Register | None, values: Mapping[Register, int]) -> tuple[Change, ...]:
    """Make the servo hold all ``values``; what had to be changed. The ID comes last, so that none is left behind.

    An exception carries a note of what had been changed before it.
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
    """Have an exception carry what had been written before it."""
    for change in changes:
        error.add_note(f"written before that: {change}")


def _check(register: Register, value: int) -> None:
    """ValueError, before anything is sent, for what can never work."""
    if register.access is Access.READ or not register.persistent:
        raise ValueError(f"{register.name} is not a setting that can be saved: nothing written")
    if register.name in LEAVES_THE_LINE:
        raise ValueError(f"{register.name} takes the servo off this line, out of reach of a check: nothing written")
    if ANSWERS_NO_READ.get(register.name) == value:
        raise ValueError(
            f"{register.name} {value} keeps the servo from answering reads, out of reach of a check: nothing written"
        )
    if register.name == "id" and value > LARGEST_ID:
        raise ValueError(f"id takes 0 to {LARGEST_ID}, not {value}: nothing written")
    register.check(value)


def _why(failure: ServoError | None) -> str:
    return "the servo does not take it" if failure is None else f"it {failure.text}"

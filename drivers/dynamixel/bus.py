"""Dynamixel X servos on one port: single-servo calls by the SDK, group transactions by us."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_SUCCESS, Protocol2PacketHandler

from drivers.bus import Reading, ServoFault, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import wire, x_series
from drivers.dynamixel.sdk import SdkPort
from drivers.errors import ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.port import Port
from drivers.registers import Register, ServoModel
from drivers.turns import Steps

FIRST_REPLY_S = 0.02
"""How long the first reply may take: a USB adapter's latency timer can be 16 ms."""
GAP_S = 0.003
"""How long the next reply may take once replies come."""
ASKED_ALWAYS = 2
"""Up to this many misses in a row a servo is asked in every cycle: replies get lost, machines stall."""
PROBE_S = 0.4
"""How often a cycle asks those that missed more: each time it waits for them."""

_ORDER: Final = "little"
_END: Final = x_series.STATE_BLOCK_END
_ADDRESSES: Final = (
    x_series.STATE_BLOCK_ADDRESS,
    x_series.moving.address,
    x_series.realtime_tick.address,
)
"""Where to begin reading the state. After a lost reply the next begins elsewhere: should the lost one
come late, its length tells that it is no answer to the present request."""
_GOAL_ADDRESS: Final = x_series.GOAL_BLOCK[0].address
_GOAL_SIZE: Final = sum(register.size for register in x_series.GOAL_BLOCK)
_LARGEST_PROFILE: Final = 32767


class DynamixelBus:
    """A ServoBus of X series servos (protocol 2.0) in position mode."""

    def __init__(self, port: Port, clock: Clock, position_p: Mapping[int, int] | None = None) -> None:
        """``position_p``: the position P gain of servos (by ID) that are not to have the factory's.

        The gain lives in RAM: it is written whenever the torque goes on.
        """
        self._port = port
        self._clock = clock
        self._position_p = dict(position_p or {})
        self._sdk_port = SdkPort(port, clock)
        self._sdk = Protocol2PacketHandler()
        self._misses: dict[int, int] = {}  # of those that did not answer last time, in the order to ask them
        self._block = 0
        self._next_probe_s = clock.now()
        self.counters = BusCounters()

    @property
    def name(self) -> str:
        return self._port.name

    def identify(self, servo_id: int, model: ServoModel) -> None:
        number, result, _ = self._sdk.ping(self._sdk_port, servo_id)
        _raise_for(servo_id, result)
        if number != model.number:
            known = next((m.name for m in x_series.MODELS.values() if m.number == number), "unknown")
            raise ServoRefused(
                servo_id,
                f"is model {number} ({known}), not {model.number} ({model.name}): "
                "correct the model in the robot file or swap the servo",
            )
        self._check_modes(servo_id)

    def _check_modes(self, servo_id: int) -> None:
        """The settings that would give our goals another meaning."""
        mode = self.read(servo_id, x_series.operating_mode)
        if mode != x_series.POSITION_MODE:
            raise ServoRefused(servo_id, f"is in operating mode {mode}: set it to {x_series.POSITION_MODE} (position)")
        drive = self.read(servo_id, x_series.drive_mode)
        if drive & x_series.TIME_BASED_PROFILE:
            raise ServoRefused(servo_id, "has a time-based profile: clear bit 2 of its drive mode")
        if drive & x_series.TORQUE_ON_BY_GOAL:
            raise ServoRefused(servo_id, "switches its torque on by itself: clear bit 3 of its drive mode")

    def read(self, servo_id: int, register: Register) -> int:
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, 0, 0, servo_id, 7, 0, wire.READ, *wire.span(register.address, register.size), 0, 0]
        reply = self._ask(servo_id, request)
        data = bytes(reply[9 : reply[5] + (reply[6] << 8) + 5])
        if len(data) != register.size:
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {register.name}")
        return register.decode(data, _ORDER)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        data = list(register.encode(value, _ORDER))
        result, error = self._sdk.writeTxRx(self._sdk_port, servo_id, register.address, register.size, data)
        _raise_for(servo_id, result, error)

    def _ask(self, servo_id: int, request: list[int]) -> Any:
        reply, result, error = self._sdk.txRxPacket(self._sdk_port, request)
        _raise_for(servo_id, result, error)
        return reply

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> dict[int, Reading]:
        # Whether a servo waits in vain for one before it that is silent, the manual does not say. So those
        # that were missing are asked last, and whoever may have waited in vain is asked once more.
        order = self._whom_to_ask(servo_ids, patient=deadline_s is None)
        replies, corrupt_ids = self._exchange(order) if order else ({}, [])
        again = self._whom_to_ask_again([i for i in order if i not in replies], deadline_s)
        if again:
            second, corrupt_second = self._exchange(again, deadline_s)
            replies |= second
            corrupt_ids += corrupt_second
        self._note(order, [i for i in order if i not in replies])
        self._count(servo_ids, order, again, replies, corrupt_ids)
        return {i: self._state(replies[i]) if i in replies else _fault(i, corrupt_ids) for i in servo_ids}

    def _whom_to_ask(self, servo_ids: Sequence[int], patient: bool) -> list[int]:
        """The missing ones last; in a cycle, those that stay missing only now and then."""
        order = [i for i in servo_ids if i not in self._misses]
        order += [i for i in self._misses if i in servo_ids]
        now_s = self._clock.now()
        if not patient and now_s < self._next_probe_s:
            return [i for i in order if self._misses.get(i, 0) <= ASKED_ALWAYS]
        self._next_probe_s = now_s + PROBE_S
        return order

    def _whom_to_ask_again(self, missing: Sequence[int], deadline_s: float | None) -> list[int]:
        """Of those that were not silent before: all while there is time, else whoever was behind another."""
        if deadline_s is None:
            missing = missing[1:]
        elif self._clock.now() >= deadline_s:
            return []
        return [i for i in missing if i not in self._misses]

    def _note(self, asked: Sequence[int], missing: Sequence[int]) -> None:
        """Count misses in a row. The first of the missing is the last to be asked: it may hide the others."""
        misses = {i: self._misses.get(i, 0) + 1 for i in (*missing[1:], *missing[:1])}
        self._misses = {i: count for i, count in self._misses.items() if i not in asked} | misses

    def _count(
        self,
        servo_ids: Sequence[int],
        asked: Sequence[int],
        again: Sequence[int],
        replies: Mapping[int, wire.Reply],
        corrupt_ids: Sequence[int],
    ) -> None:
        for i in servo_ids:
            account = self.counters.of(i)
            account.skipped += i not in asked
            account.retries += i in again
            account.replies += i in replies
            account.alarms += i in replies and bool(replies[i].error & wire.ALERT)
            if i in asked and i not in replies:
                account.corrupt += i in corrupt_ids
                account.silent += i not in corrupt_ids

    def _exchange(
        self, servo_ids: Sequence[int], until_s: float | None = None
    ) -> tuple[dict[int, wire.Reply], list[int]]:
        """One sync read: the replies, and who sent a broken one."""
        address = _ADDRESSES[self._block]
        block_size = _END - address
        self._port.discard_input()
        self._port.write(wire.sync_read(servo_ids, address, block_size))
        decoder = wire.ReplyDecoder(block_size)
        replies: dict[int, wire.Reply] = {}
        frame_size = block_size + wire.OVERHEAD
        size, deadline_s = frame_size, self._clock.now() + FIRST_REPLY_S
        end_s = deadline_s + len(servo_ids) * GAP_S  # however much noise there is
        if until_s is not None:
            end_s = min(end_s, until_s)
        while len(replies) < len(servo_ids) and (data := self._port.read(size, min(deadline_s, end_s))):
            replies |= {reply.servo_id: reply for reply in decoder.feed(data) if reply.servo_id in servo_ids}
            size = max(1, len(servo_ids) - len(replies)) * frame_size
            deadline_s = self._clock.now() + size * 10.0 / self._port.baud + GAP_S
        if len(replies) < len(servo_ids):
            self._block = (self._block + 1) % len(_ADDRESSES)
        return replies, decoder.corrupt_ids

    def _state(self, reply: wire.Reply) -> ServoState:
        begin = _END - len(reply.data)

        def value(register: Register) -> int:
            start = register.address - begin
            return register.decode(reply.data[start : start + register.size], _ORDER)

        return ServoState(
            position_counts=value(x_series.present_position),
            velocity_counts_s=round(value(x_series.present_velocity) * x_series.VELOCITY_UNIT_COUNTS_S),
            load=value(x_series.present_pwm) / x_series.FULL_PWM,
            voltage_v=value(x_series.present_voltage) * x_series.VOLTAGE_UNIT_V,
            temperature_c=float(value(x_series.present_temperature)),
            alarms=self._alarms(reply.servo_id) if reply.error & wire.ALERT else (),
        )

    def _alarms(self, servo_id: int) -> tuple[str, ...]:
        """What the alert bit stands for. Asked only then: it is a transaction of its own."""
        try:
            return x_series.alarms(self.read(servo_id, x_series.hardware_error_status))
        except ServoError:
            return ("hardware error",)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        data = {servo_id: _goal_bytes(goal) for servo_id, goal in goals.items()}
        self._port.write(wire.sync_write(_GOAL_ADDRESS, _GOAL_SIZE, data))

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[dict[int, Reading]]:
        yield
        return self.read_states(servo_ids, deadline_s)

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> dict[int, Reading]:
        self.write_goals(goals)
        return self.read_states(servo_ids, deadline_s)

    def exchange_size(self, servo_ids: Sequence[int]) -> int:
        address, ids = _ADDRESSES[0], tuple(servo_ids)
        goals = wire.sync_write(_GOAL_ADDRESS, _GOAL_SIZE, {i: bytes(_GOAL_SIZE) for i in ids})
        question = wire.sync_read(ids, address, _END - address)
        return len(goals) + len(question) + (_END - address + wire.OVERHEAD) * len(ids)

    def goal(self, servo_id: int) -> int:
        return self.read(servo_id, x_series.goal_position)

    def torque_is_on(self, servo_id: int) -> bool:
        return self.read(servo_id, x_series.torque_enable) == 1

    def torque_on(self, servo_id: int) -> None:
        # No ramp of the servo's own: the trajectory above is smooth already, and a ramp would stop
        # the servo at every goal.
        self.write(servo_id, x_series.profile_acceleration, 0)
        if servo_id in self._position_p:
            self.write(servo_id, x_series.position_p_gain, self._position_p[servo_id])
        self.write(servo_id, x_series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        register = x_series.torque_enable
        off = {servo_id: register.encode(0, _ORDER) for servo_id in servo_ids}
        self._port.write(wire.sync_write(register.address, register.size, off))
        failed: list[ServoError] = []
        for servo_id in servo_ids:
            try:
                self.write(servo_id, register, 0)
            except ServoError as error:
                failed.append(error)
        return failed

    def limit_torque(self, servo_id: int, share: float) -> None:
        # Beyond its PWM limit the servo would refuse.
        limit = self.read(servo_id, x_series.pwm_limit)
        self.write(servo_id, x_series.goal_pwm, min(round(share * x_series.FULL_PWM), limit))

    def close(self) -> None:
        self._port.close()


def profile_units(velocity_counts_s: int) -> int:
    """A speed as profile_velocity, rounded up: the servo is never slower than asked. 0 stays 0."""
    return min(math.ceil(velocity_counts_s / x_series.VELOCITY_UNIT_COUNTS_S), _LARGEST_PROFILE)


def _goal_bytes(goal: ServoGoal) -> bytes:
    values = (profile_units(goal.velocity_counts_s), goal.position_counts)
    return b"".join(r.encode(v, _ORDER) for r, v in zip(x_series.GOAL_BLOCK, values, strict=True))


def _fault(servo_id: int, corrupt_ids: Sequence[int]) -> ServoFault:
    if servo_id in corrupt_ids:
        return ServoFault("corrupt", f"servo {servo_id} answered with a wrong checksum")
    return ServoFault("silent", f"servo {servo_id} does not answer")


def _raise_for(servo_id: int, result: int, error: int = 0) -> None:
    """Turn the SDK's result code and the reply's error number into an error.

    The alert bit is no failure: alarms are states.
    """
    if result == COMM_RX_CORRUPT:
        raise ServoCorrupt(servo_id, "answered with a broken packet: check the cable's plugs")
    if result != COMM_SUCCESS:
        raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")
    number = error & ~wire.ALERT
    if number:
        raise ServoRefused(servo_id, wire.ERRORS.get(number, f"answered error {number}"))

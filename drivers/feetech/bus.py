"""Feetech STS servos on one port: single-servo calls by the SDK, group transactions by us."""

from collections.abc import Mapping, Sequence
from typing import Final

from scservo_sdk import COMM_RX_CORRUPT, COMM_SUCCESS, INST_READ, PacketHandler

from drivers.bus import Reading, ServoFault, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.feetech import sts, wire
from drivers.feetech.sdk import SdkPort
from drivers.port import Port
from drivers.registers import Register, ServoModel

FIRST_REPLY_S = 0.02
"""How long the first reply may take: a USB adapter's latency timer can be 16 ms."""
GAP_S = 0.003
"""How long the next reply may take once replies come."""

_ORDER: Final = "little"
_STATE_ADDRESS = sts.STATE_BLOCK[0].address
_STATE_SIZE = sum(register.size for register in sts.STATE_BLOCK)
_GOAL_ADDRESS = sts.GOAL_BLOCK[0].address
_GOAL_SIZE = sum(register.size for register in sts.GOAL_BLOCK)


class FeetechBus:
    """A ServoBus of STS servos (protocol 0, little endian)."""

    def __init__(self, port: Port, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._sdk_port = SdkPort(port, clock)
        self._sdk = PacketHandler(0)

    @property
    def name(self) -> str:
        return self._port.name

    def identify(self, servo_id: int, model: ServoModel) -> None:
        number = self.read(servo_id, sts.model_number)
        if number != model.number:
            known = next((m.name for m in sts.MODELS.values() if m.number == number), "unknown")
            raise ServoRefused(
                servo_id,
                f"is model {number} ({known}), not {model.number} ({model.name}): "
                "correct the model in the robot file or swap the servo",
            )

    def read(self, servo_id: int, register: Register) -> int:
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, servo_id, 4, INST_READ, register.address, register.size, 0]
        reply, result, _ = self._sdk.txRxPacket(self._sdk_port, request)
        _raise_for(servo_id, result)
        data = reply[5 : reply[3] + 3]
        if len(data) != register.size:
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {register.name}")
        return register.decode(bytes(data), _ORDER)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        data = list(register.encode(value, _ORDER))
        result, _ = self._sdk.writeTxRx(self._sdk_port, servo_id, register.address, register.size, data)
        _raise_for(servo_id, result)

    def read_states(self, servo_ids: Sequence[int]) -> dict[int, Reading]:
        self._port.discard_input()
        self._port.write(wire.sync_read(servo_ids, _STATE_ADDRESS, _STATE_SIZE))
        decoder = wire.ReplyDecoder(_STATE_SIZE)
        states: dict[int, Reading] = {}
        frame_size = _STATE_SIZE + wire.OVERHEAD
        missing = len(servo_ids)
        size, deadline_s = frame_size, self._clock.now() + FIRST_REPLY_S
        end_s = deadline_s + missing * GAP_S  # however much noise there is
        while missing and (data := self._port.read(size, min(deadline_s, end_s))):
            for reply in decoder.feed(data):
                if reply.servo_id in servo_ids:
                    states[reply.servo_id] = _state(reply)
            missing = len(servo_ids) - len(states)
            size = max(1, missing) * frame_size
            deadline_s = self._clock.now() + size * 10.0 / self._port.baud + GAP_S
        return {i: states.get(i) or _fault(i, decoder.corrupt_ids) for i in servo_ids}

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        data = {servo_id: _goal_bytes(goal) for servo_id, goal in goals.items()}
        self._port.write(wire.sync_write(_GOAL_ADDRESS, _GOAL_SIZE, data))

    def goal(self, servo_id: int) -> int:
        return self.read(servo_id, sts.goal_position)

    def torque_is_on(self, servo_id: int) -> bool:
        return self.read(servo_id, sts.torque_enable) == 1

    def torque_on(self, servo_id: int) -> None:
        self.write(servo_id, sts.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        off = {servo_id: sts.torque_enable.encode(0, _ORDER) for servo_id in servo_ids}
        self._port.write(wire.sync_write(sts.torque_enable.address, sts.torque_enable.size, off))
        failed: list[ServoError] = []
        for servo_id in servo_ids:
            try:
                self.write(servo_id, sts.torque_enable, 0)
            except ServoError as error:
                failed.append(error)
        return failed

    def limit_torque(self, servo_id: int, share: float) -> None:
        self.write(servo_id, sts.torque_limit, round(share / sts.TORQUE_UNIT))

    def close(self) -> None:
        self._port.close()


def _goal_bytes(goal: ServoGoal) -> bytes:
    # Acceleration 0, no ramp of the servo's own: the trajectory above is smooth already, and a ramp
    # would stop the servo at every goal.
    values = (0, goal.position_counts, 0, goal.velocity_counts_s)
    return b"".join(r.encode(v, _ORDER) for r, v in zip(sts.GOAL_BLOCK, values, strict=True))


def _state(reply: wire.Reply) -> ServoState:
    values: list[int] = []
    offset = 0
    for register in sts.STATE_BLOCK:
        values.append(register.decode(reply.data[offset : offset + register.size], _ORDER))
        offset += register.size
    position, velocity, load, voltage, temperature = values
    return ServoState(
        position_counts=position,
        velocity_counts_s=velocity,
        load=load * sts.TORQUE_UNIT,
        voltage_v=voltage * sts.VOLTAGE_UNIT_V,
        temperature_c=float(temperature),
        alarms=sts.alarms(reply.status),
    )


def _fault(servo_id: int, corrupt_ids: Sequence[int]) -> ServoFault:
    if servo_id in corrupt_ids:
        return ServoFault("corrupt", f"servo {servo_id} answered with a wrong checksum")
    return ServoFault("silent", f"servo {servo_id} does not answer")


def _raise_for(servo_id: int, result: int) -> None:
    """Turn the SDK's result code into an error. The status byte is no failure: alarms are states."""
    if result == COMM_SUCCESS:
        return
    if result == COMM_RX_CORRUPT:
        raise ServoCorrupt(servo_id, "answered with a broken packet: check the cable's plugs")
    raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")

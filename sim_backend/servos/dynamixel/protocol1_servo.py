"""Virtual AX and MX protocol 1.0 servos. The servos have their own tables and share their firmware with the SCS
servos.

From the e-manual:
- The tables, with their factory values and units.
- The modes that the angle limits select, and the replies at each status return level.
- A factory reset sets the ID to 1, and the lock ends at power-off.
- A value outside the range of its register causes a range error. (Assumed: no part of the instruction is then written.)
- The gains of an MX are P / 8, I * 1000 / 2048 and D * 4 / 1000.

BAM (github.com/Rhoban/bam) measured the drive per unit of P and the full drive on MX-64 and MX-106. The virtual MX-28
uses the same values. Assumed:
- The I and D gains of an MX use the same unit of drive as P, with times in seconds and errors in counts.
- The position loop of an AX is as stiff as that of an SCS servo, regardless of its compliance registers.
- A servo reports an overload after two seconds of nearly full drive. After an overload, the drive is zero until the
  torque switch is written.
- Packets with a wrong checksum do not get a reply, and goals outside the limits are clipped.
"""

from collections.abc import Mapping
from typing import ClassVar, Final

from drivers.servos import ax_mx as dxl
from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code, status_packet
from sim_backend.servos.dynamixel.motors import motor_of
from sim_backend.servos.generic.firmware import MULTI_TURN_PHASE, GenericFirmware
from sim_backend.servos.generic.memory import Memory
from sim_backend.servos.generic.servo import GenericServo

MX_DRIVE_PER_RAD: Final = 0.158
"""Drive per rad for each unit of ``p_gain``, as a fraction of full drive. The e-manual's value, P / 8 per count of 512,
would be 0.159."""
MX_FULL_DRIVE: Final = 0.9625
_MX_P_UNIT: Final = 1.0 / 8.0
_MX_I_UNIT: Final = 1000.0 / 2048.0
_MX_D_UNIT: Final = 4.0 / 1000.0
RANGE_ERROR: Final = 1 << 3
INSTRUCTION_ERROR: Final = 1 << 6
_BASE_BAUD: Final = 2_000_000
_FAST_BAUDS: Final = {250: 2_250_000, 251: 2_500_000, 252: 3_000_000}

_OWN: Final = {
    sts.firmware_major.name: dxl.firmware_version,
    sts.servo_id.name: dxl.servo_id,
    sts.min_position.name: dxl.cw_angle_limit,
    sts.max_position.name: dxl.ccw_angle_limit,
    sts.max_temperature.name: dxl.temperature_limit,
    sts.max_voltage.name: dxl.max_voltage_limit,
    sts.min_voltage.name: dxl.min_voltage_limit,
    sts.unloading_condition.name: dxl.shutdown,
    sts.status_level.name: dxl.status_return_level,
    sts.goal_velocity.name: dxl.moving_speed,
    sts.present_velocity.name: dxl.present_speed,
    sts.async_write_flag.name: dxl.registered_instruction,
    **{register.name: register for register in dxl.COMMON},
}
"""Register of these tables, keyed by the name of the corresponding STS register. Bits 0, 2 and 5 have the same meaning
in both status bytes."""
_ABSENT: Final = {
    sts.protection_current.name: sts.protection_current.largest,  # not measured
    sts.position_p.name: 32,
    sts.position_d.name: 32,
    sts.overload_torque.name: 98,
    sts.protection_time.name: 200,
    sts.protective_torque.name: 0,
}
"""Values that the firmware uses if the table has no such register. All other values are 0."""

_COMMON_FACTORY: Final[dict[Register, int]] = {
    dxl.firmware_version: 24,  # assumed
    dxl.baud_rate: 1,
    dxl.return_delay: 250,
    dxl.min_voltage_limit: 60,
    dxl.max_torque: dxl.FULL_TORQUE,
    dxl.status_return_level: dxl.ANSWERS_ALL,
    dxl.alarm_led: 36,
    dxl.shutdown: 36,
}
_OWN_FACTORY: Final[dict[str, dict[Register, int]]] = {
    dxl.AX_12W.name: {
        dxl.cw_compliance_margin: 4, dxl.ccw_compliance_margin: 4,
        dxl.cw_compliance_slope: 64, dxl.ccw_compliance_slope: 64,
    },
    dxl.AX_18A.name: {dxl.temperature_limit: 75, dxl.max_torque: 983},
    dxl.RX_24F.name: {dxl.temperature_limit: 80, dxl.max_voltage_limit: 190},
    dxl.RX_28.name: {dxl.temperature_limit: 80, dxl.max_voltage_limit: 190},
    dxl.RX_64.name: {dxl.temperature_limit: 80, dxl.max_voltage_limit: 190},
    dxl.EX_106.name: {dxl.temperature_limit: 80, dxl.max_voltage_limit: 240, dxl.punch: 0},
    dxl.MX_12W.name: {dxl.d_gain: 8, dxl.p_gain: 8, dxl.punch: 32},
    dxl.MX_64.name: {dxl.max_voltage_limit: 240},
}  # fmt: skip
"""Factory values, keyed by model name, for models that differ from the AX-12A or the MX-28."""


class Dynamixel1Memory(Memory):
    """A control table of protocol 1.0. STS registers are found by name, and their values are converted to STS units."""

    FACTORY: ClassVar[Mapping[Register, int]]
    EEPROM_END = dxl.torque_enable.address
    RESET_ID = 1
    BAUDS = 255

    def __init__(self, model: dxl.AxMxModel, servo_id: int) -> None:
        registers = dxl.registers(model)
        self._own = {**_OWN, **{register.name: register for register in registers}}
        load_unit = 1.0 / sts.TORQUE_UNIT / dxl.FULL_TORQUE
        self._scales = {
            sts.goal_velocity.name: model.speed_unit_counts_s,
            sts.present_velocity.name: model.speed_unit_counts_s,
            sts.max_torque.name: load_unit,
            sts.torque_limit.name: load_unit,
            sts.present_load.name: load_unit,
        }
        own = _OWN_FACTORY.get(model.name, {})
        factory = {**_COMMON_FACTORY, **self.FACTORY, **own, dxl.ccw_angle_limit: model.last_count}
        super().__init__(model, servo_id, registers, factory)

    def _decode_baud(self) -> int:
        index = self.get(dxl.baud_rate)
        return _FAST_BAUDS.get(index, _BASE_BAUD // (index + 1))

    @property
    def answers(self) -> int:
        return self.get(dxl.status_return_level)

    def own(self, register: Register) -> Register | None:
        return self._own.get(register.name)

    def _scale(self, register: Register, own: Register) -> float:
        """Return the number of units of ``register`` in one unit of its counterpart ``own``; 1 if they are the same."""
        scale = self._scales.get(register.name, 1.0)
        return 1.0 if scale != 1.0 and own == register else scale

    def get(self, register: Register) -> int:
        own = self.own(register)
        if own is None:
            return self._substitute(register)
        value, scale = super().get(own), self._scale(register, own)
        return value if scale == 1.0 else round(value * scale)

    def _substitute(self, register: Register) -> int:
        if register == sts.operating_mode:
            return int(self.limits == (0, 0))
        if register == sts.phase:
            return MULTI_TURN_PHASE if self._unwrapped() else 0
        absent = _ABSENT.get(register.name, 0)
        if register == sts.overload_torque:
            return int(absent * super().get(dxl.max_torque) / dxl.FULL_TORQUE)
        return absent

    @property
    def limits(self) -> tuple[int, int]:
        """Both angle limits, which select the mode."""
        return self.get(dxl.cw_angle_limit), self.get(dxl.ccw_angle_limit)

    def _unwrapped(self) -> bool:
        """Return whether the servo counts positions beyond one turn."""
        return self.limits == (dxl.MULTI_TURN_LIMIT, dxl.MULTI_TURN_LIMIT)

    def put(self, register: Register, value: int) -> None:
        own = self.own(register)
        if own is not None:
            super().put(own, round(value / self._scale(register, own)))

    def _write_byte(self, at: int, value: int) -> None:
        """Write a byte. Every write to EEPROM bytes is saved. Locked bytes cannot be changed."""
        if at >= self.EEPROM_END:
            self._bytes[at] = value | (self._bytes[at] if at == dxl.lock.address else 0)
        elif not self.get(dxl.lock):
            self._bytes[at] = self._saved[at] = value


class AxMemory(Dynamixel1Memory):
    """Table of an AX, whose potentiometer reads from 0 to 1023. Factory values are those of the AX-12A."""

    FACTORY: ClassVar[Mapping[Register, int]] = {
        dxl.temperature_limit: 70,
        dxl.max_voltage_limit: 140,
        dxl.cw_compliance_margin: 1,
        dxl.ccw_compliance_margin: 1,
        dxl.cw_compliance_slope: 32,
        dxl.ccw_compliance_slope: 32,
        dxl.punch: 32,
    }

    def _unwrapped(self) -> bool:
        return True

    def put(self, register: Register, value: int) -> None:
        if register.name == dxl.present_position.name:
            value = max(0, min(self._model.last_count, value))
        super().put(register, value)


class MxMemory(Dynamixel1Memory):
    """Table of an MX, whose magnetic encoder has 4096 counts per turn. Factory values are those of the MX-28."""

    FACTORY: ClassVar[Mapping[Register, int]] = {
        dxl.temperature_limit: 80,
        dxl.max_voltage_limit: 160,
        dxl.resolution_divider: 1,
        dxl.p_gain: 32,
    }

    def _substitute(self, register: Register) -> int:
        if register == sts.acceleration:
            ramp = super().get(dxl.goal_acceleration) * dxl.ACCELERATION_UNIT_COUNTS_S2
            return round(ramp / sts.ACCELERATION_UNIT_COUNTS_S2)
        if register == sts.overload_torque:
            return int(super()._substitute(register) * MX_FULL_DRIVE)
        return super()._substitute(register)


class AxFirmware(GenericFirmware):
    """Control loop of an AX, which uses the model's own counts."""

    def load_settings(self) -> None:
        super().load_settings()
        self._gain *= sts.STS3215.counts_per_turn / self._turn


class MxFirmware(GenericFirmware):
    """Control loop of an MX, whose gains are in RAM."""

    def load_goal(self) -> None:
        super().load_goal()
        get, unit = self._memory.get, MX_DRIVE_PER_RAD / _MX_P_UNIT / self._counts_per_rad
        self._gain = get(dxl.p_gain) * _MX_P_UNIT * unit
        self._integral_gain = get(dxl.i_gain) * _MX_I_UNIT * unit
        self._damping = get(dxl.d_gain) * _MX_D_UNIT * unit
        self._limit = min(self._limit, MX_FULL_DRIVE)


class VirtualAxServo(GenericServo):
    """An AX on a virtual bus. An AX has no group read."""

    MEMORY: ClassVar[type[Dynamixel1Memory]] = AxMemory
    FIRMWARE: ClassVar[type[GenericFirmware]] = AxFirmware
    GROUP_READ: ClassVar[Code | None] = None
    REBOOTS = False

    def __init__(self, model: dxl.AxMxModel, servo_id: int) -> None:
        memory = self.MEMORY(model, servo_id)
        self._ranged = [register for register in dxl.registers(model) if register.values]
        motor = motor_of(model)
        super().__init__(model, memory, self.FIRMWARE(memory, model, motor))
        self.gears = motor.gears

    def answer(self, instruction: Instruction) -> bytes | None:
        known = {Code.PING, Code.READ, Code.WRITE, Code.REG_WRITE, Code.ACTION, Code.RESET}
        if instruction.code not in known:
            return self._refusal(INSTRUCTION_ERROR)
        address, *data = instruction.parameters or (0,)
        if instruction.code in (Code.WRITE, Code.REG_WRITE) and self._out_of_range(address, bytes(data)):
            return self._refusal(RANGE_ERROR)
        return super().answer(instruction)

    def write(self, address: int, data: bytes) -> None:
        """Write bytes received over the bus, unless the value of a register would be outside its range."""
        if not self._out_of_range(address, data):
            super().write(address, data)

    def _out_of_range(self, address: int, data: bytes) -> bool:
        for register in self._ranged:
            at = register.address - address
            if 0 <= at <= len(data) - register.size:
                value = register.decode(data[at : at + register.size], "little")
                if not register.takes(value):
                    return True
        return False

    def _refusal(self, error: int) -> bytes | None:
        error |= self.firmware.protection.status
        return status_packet(self.servo_id, error) if self.memory.answers == dxl.ANSWERS_ALL else None


class VirtualMxServo(VirtualAxServo):
    """An MX with protocol 1.0 firmware on a virtual bus. The servo supports bulk reads."""

    MEMORY = MxMemory
    FIRMWARE = MxFirmware
    GROUP_READ = Code.BULK_READ

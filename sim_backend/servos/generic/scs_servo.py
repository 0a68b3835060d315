"""One virtual servo of the SCS series or a similar series: the common firmware with a different table and a
potentiometer.

Factory values are from Feetech's SCS memory table; values that are not in this table are assumed. Also assumed: per
radian of error, the position loop uses the same fraction of full drive as that of an STS servo.
"""

from typing import ClassVar, Final

from drivers.servos import scs, sts
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.packets.sts import Code
from sim_backend.servos.generic.firmware import GenericFirmware
from sim_backend.servos.generic.memory import Memory
from sim_backend.servos.generic.servo import GenericServo

_ABSENT: Final = {
    sts.protection_current.name: sts.protection_current.largest,  # These servos do not measure this value.
}
"""Values that the firmware uses if the table has no such register. All other values are 0."""
_TIME_UNITS: Final = 4
"""Unit of the protection time of an SCS servo (40 ms), in units of the protection time of an STS servo (10 ms)."""

FACTORY: Final[dict[Register, int]] = {
    scs.firmware_major: 3,
    scs.baud_rate: 0,
    scs.return_delay: 0,
    scs.status_level: 1,
    scs.max_temperature: 80,
    scs.max_voltage: 90,
    scs.min_voltage: 40,
    scs.max_torque: 1000,
    scs.unloading_condition: 36,  # temperature, overload
    scs.led_alarm_condition: 37,
    scs.position_p: 32,
    scs.position_d: 32,
    scs.cw_dead_zone: 1,
    scs.ccw_dead_zone: 1,
    scs.protective_torque: 20,
    scs.protection_time: 50,
    scs.overload_torque: 80,
    scs.lock: 1,
}
"""Factory values. All other registers are 0, except for ``max_position``, which is the last count of the model."""


class ScsMemory(Memory):
    """Control table of an SCS series. STS registers are found by name."""

    def __init__(self, model: ServoModel, servo_id: int) -> None:
        registers = series_of(model).registers
        self._own = {register.name: register for register in registers}
        factory = {**FACTORY, scs.max_position: model.last_count}
        super().__init__(model, servo_id, registers, {self._own[r.name]: value for r, value in factory.items()})

    def own(self, register: Register) -> Register | None:
        return self._own.get(register.name)

    def get(self, register: Register) -> int:
        own = self.own(register)
        if own is not None:
            return super().get(own) * (_TIME_UNITS if register == sts.protection_time else 1)
        if register == sts.torque_limit:
            return self.get(sts.max_torque)
        if register == sts.operating_mode:
            return int(self.get(sts.min_position) == self.get(sts.max_position) == 0)
        return _ABSENT.get(register.name, 0)

    def put(self, register: Register, value: int) -> None:
        own = self.own(register)
        if own is None:
            return
        if own.name == sts.present_position.name:
            value = max(0, min(self._model.last_count, value))
        super().put(own, value)


class ScsFirmware(GenericFirmware):
    """Control loop of servos with coarser counts. The counts do not wrap around, but end where the potentiometer's
    range ends."""

    def load_settings(self) -> None:
        super().load_settings()
        self._multi_turn = True
        self._gain *= sts.STS3215.counts_per_turn / self._turn


class VirtualScsServo(GenericServo):
    """An SCS servo on a virtual bus. The servo supports neither sync reads nor a homing offset, and its readings end
    where the sensor's range ends."""

    GROUP_READ: ClassVar[Code | None] = None

    def __init__(self, model: ServoModel, servo_id: int) -> None:
        memory = ScsMemory(model, servo_id)
        super().__init__(model, memory, ScsFirmware(memory, model, MotorConstants.of(model)))

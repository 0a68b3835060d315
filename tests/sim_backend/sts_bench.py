"""One virtual STS servo on a shaft with a load. The registers of the servo are accessed by name."""

from math import pi

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.line.rig import Rig, Supply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.firmware import AS_REIMPLEMENTED, StsVariant
from sim_backend.servos.sts.servo import VirtualServo

DT_S = 0.001
COUNTS_PER_RAD = 4096 / (2 * pi)


class StsBench:
    """A servo on a shaft. A positive ``load_nm`` constantly pulls toward larger counts."""

    def __init__(
        self,
        load_nm: float = 0.0,
        *,
        model: ServoModel = sts.STS3215,
        variant: StsVariant = AS_REIMPLEMENTED,
        timestep_s: float = DT_S,
        supply: Supply | None = None,
    ) -> None:
        self.plant = BenchPlant([1], timestep_s=timestep_s)
        self.plant.load_nm[:] = [load_nm]
        self.servo = VirtualServo(model, 1, variant=variant)
        self.rig = Rig([self.servo], self.plant, supply or Supply(model.rated_voltage_v, 0.0))

    def __setitem__(self, register: Register, value: int) -> None:
        """Write a register and make it take effect. Registers 85 and 86 take effect only after a write to register 41,
        and the phase register after a write to register 46."""
        self.servo.write(register.address, register.encode(value, "little"))
        if register in (sts.acceleration, sts.goal_velocity):
            self.run(0.001)
        elif register in (sts.max_acceleration, sts.acceleration_multiplier):
            self[sts.acceleration] = self[sts.acceleration]
        elif register == sts.phase:
            self[sts.goal_velocity] = self[sts.goal_velocity]

    def __getitem__(self, register: Register) -> int:
        return register.decode(self.servo.read(register.address, register.size), "little")

    def write(self, address: int, *data: int) -> None:
        self.servo.write(address, bytes(data))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.rig.timestep_s)):
            self.rig.step()

    def turn_to(self, count: float) -> None:
        """Turn the shaft by hand to a new angle at once. The servo measures the new angle within a few milliseconds."""
        self.plant.place([(count + 0.5) / COUNTS_PER_RAD])

    def held_at(self, count: float, seconds: float) -> None:
        """Run while the shaft is held at this count."""
        for _ in range(round(seconds / self.rig.timestep_s)):
            self.turn_to(count)
            self.rig.step()

    def go(self, count: int) -> None:
        """Write a goal, and run for a millisecond so that the servo uses the goal."""
        self[sts.goal_position] = count
        self.run(0.001)

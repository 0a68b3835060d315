"""Virtual STS3215 servos on a bench that tests access only through bytes on the bus."""

from math import pi

from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.rig import Supply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo

COUNTS_PER_RAD = 4096 / (2 * pi)


def packet(servo_id: int, code: int, *parameters: int) -> bytes:
    body = bytes((servo_id, len(parameters) + 2, code, *parameters))
    return b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))


def word(value: int) -> bytes:
    return value.to_bytes(2, "little")


class Wire:
    """Servos with or without a load. Time passes with each packet, and in ``wait``."""

    def __init__(self, *servo_ids: int, load_nm: float = 0.0, paced: bool = False) -> None:
        self.ids = servo_ids or (1,)
        self.plant = BenchPlant(self.ids)
        self.plant.load_nm[:] = [load_nm] * len(self.ids)
        self.bus = VirtualBus.of(self.plant, sts.STS3215, supply=Supply(12.0, 0.0), paced=paced)
        self.now_s = 0.0
        self.held: float | None = None
        self.bus.advance(0.0)

    def send(self, data: bytes) -> list[bytes]:
        """Send bytes and return each reply on the wire. A millisecond passes."""
        answers = [reply.data for reply in self.bus.receive(data, self.now_s)]
        self.wait(0.001)
        return answers

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            if self.held is not None:
                self.turn_to(self.held)
            self.now_s += 0.001
            self.bus.advance(self.now_s)

    def turn_to(self, count: float) -> None:
        """Turn the shaft by hand."""
        self.plant.place([(count + 0.5) / COUNTS_PER_RAD] * len(self.ids))

    def write(self, address: int, data: bytes, servo_id: int = 1) -> None:
        assert len(self.send(packet(servo_id, 3, address, *data))) == 1

    def read(self, address: int, size: int = 1) -> int:
        """Return the number that is encoded with the low byte first."""
        (answer,) = self.send(packet(1, 2, address, size))
        assert answer[:4] == bytes((0xFF, 0xFF, 1, size + 2))
        assert ~sum(answer[2:-1]) & 0xFF == answer[-1]
        return int.from_bytes(answer[5:-1], "little")

    def error_byte(self) -> int:
        return self.send(packet(1, 1))[0][4]

    def go(self, count: int, speed: int = 0) -> None:
        self.write(42, word(count) + word(0) + word(speed))

    @property
    def servo(self) -> VirtualServo:
        servo = self.bus.servo(1)
        assert isinstance(servo, VirtualServo)
        return servo

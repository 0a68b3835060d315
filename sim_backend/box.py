"""A box of factory-new servos on a single bus. A script can connect individual servos or the whole chain.

All servos have ID 1. As delivered, they delay each reply by 500 us, a setting that LeRobot's set-up changes. The
maximum voltage of a new 7.4 V servo is assumed to be 8 V, because such servos report a voltage error at 12 V.
"""

from collections.abc import Mapping, Sequence
from math import tau
from random import Random
from typing import Any, Final

from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.control import Command, Handler
from sim_backend.line.rig import Rig, Supply
from sim_backend.mechanics.plant import BenchPlant, Plant
from sim_backend.servos.generic.packet_servo import PacketServo
from sim_backend.servos.sts.servo import VirtualServo

FACTORY_ID: Final = 1
FACTORY_RETURN_DELAY: Final = 250
SMALL_SERVO_V: Final = 7.4
SMALL_SERVO_MAX_VOLTAGE: Final = 80


class VirtualBox:
    """The servos, indexed by their zero-based number in the box. Initially, no servo is connected."""

    def __init__(
        self, models: Sequence[ServoModel], plant: Plant | None = None, supply: Supply | None = None, seed: int = 0
    ) -> None:
        """Create the servos.

        ``plant`` is the mechanism that the shafts drive. All couplings of the plant must have the factory ID. Without a
        plant, each shaft turns freely, and ``seed`` determines its first angle.
        """
        usual = Supply(min(model.rated_voltage_v for model in models))
        servos = [_as_delivered(model) for model in models]
        self.line = VirtualBus(Rig(servos, plant or _loose(len(models), seed), supply or usual))
        self.connect()

    @property
    def servos(self) -> tuple[PacketServo, ...]:
        """All servos, whether they are connected or not."""
        return self.line.servos

    def connect(self, *numbers: int) -> None:
        """Connect these servos and disconnect all other servos. A servo that stays connected remains powered."""
        for number, servo in enumerate(self.servos):
            (self.line.plug if number in numbers else self.line.unplug)(servo)

    def connected(self) -> list[bool]:
        """Return whether each servo is connected, ordered by servo number."""
        return [self.line.plugged(servo) for servo in self.servos]

    def ids(self) -> list[int]:
        """Return the IDs of all servos, ordered by servo number."""
        return [servo.servo_id for servo in self.servos]


def plugged(box: VirtualBox, joints: Sequence[str], hand: Handler, command: Command) -> Mapping[str, Any]:
    """Connect or disconnect servos as ``servoloop hand`` requests, and let ``hand`` handle all other commands.

    The reply also contains the ID of each joint's servo and whether that servo is connected. ``joints`` are the joint
    names, ordered by servo number. Raises ValueError if a joint is unknown.
    """
    what, wanted = command.get("do"), command.get("joints") or []
    if what not in ("connect", "disconnect"):
        return hand(command)
    if unknown := [name for name in wanted if name not in joints]:
        raise ValueError(f"the box has no servo for {', '.join(unknown)}: its joints are {', '.join(joints)}")
    chain = joints if what == "connect" else ()
    box.connect(*(joints.index(name) for name in (wanted or chain) if what == "connect"))
    plugs = zip(joints, box.ids(), box.connected(), strict=True)
    state = hand({"do": "look"})
    return {name: {**state.get(name, {}), "servo_id": servo_id, "connected": there} for name, servo_id, there in plugs}


def _as_delivered(model: ServoModel) -> PacketServo:
    servo = servo_of(model, FACTORY_ID)
    if isinstance(servo, VirtualServo):
        servo.memory.save(sts.return_delay, FACTORY_RETURN_DELAY)
        if model.rated_voltage_v <= SMALL_SERVO_V:
            servo.memory.save(sts.max_voltage, SMALL_SERVO_MAX_VOLTAGE)
        servo.memory.save_defaults()
    return servo


def _loose(count: int, seed: int) -> BenchPlant:
    """Return free shafts at random angles. The random angles let clients distinguish the replies of servos that share
    an ID."""
    plant, random = BenchPlant([FACTORY_ID] * count), Random(seed)
    plant.place([random.uniform(0.0, tau) for _ in range(count)])
    return plant

"""The Feetech SDK and rustypot read the values written by the set-up over a serial device."""

import importlib
import queue
from pathlib import Path
from typing import Any

import pytest

from commissioning.set_up.flow import SetUp, SetUpTask
from commissioning.set_up.only_one import ServoPlace
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port.serial_port import SerialPort
from drivers.servos import sts
from sim_backend.box import VirtualBox
from tests.servoloop.served import eventually, served

# The modules are imported by name, because they have no types.
sdk: Any = importlib.import_module("scservo_sdk")
PLACES = [
    ServoPlace("wrist", 5, sts.STS3215, (("position_p", 20),)),
    ServoPlace("jaw", 6, sts.STS3215, (("position_p", 16), ("protection_current", 250))),
]


class Hands:
    """Hands that connect the requested servo in the thread that serves the bus."""

    def __init__(self, box: VirtualBox) -> None:
        self.box = box
        self.wanted: queue.Queue[tuple[int, ...]] = queue.Queue()

    def tick(self, now_s: float) -> None:
        if not self.wanted.empty():
            self.box.connect(*self.wanted.queue[0])
            self.wanted.get()

    def connect(self, task: SetUpTask) -> None:
        numbers = (0, 1) if task.kind == "chain" else ([place.joint for place in PLACES].index(task.joint),)
        self.wanted.put(numbers)
        eventually(self.wanted.empty)

    def say(self, text: str) -> None:
        pass


@pytest.mark.slow
def test_the_feetech_sdk_and_rustypot_read_the_values(tmp_path: Path) -> None:
    rustypot: Any = pytest.importorskip("rustypot")
    box, clock = VirtualBox([sts.STS3215] * 2), MonotonicClock()
    hands = Hands(box)
    with served(box.line, tmp_path / "bus", hands.tick) as device:
        port = SerialPort(device, 1_000_000, clock)
        SetUp(Bus(port, clock), clock, PLACES, hands).run()
        port.close()
        theirs = sdk.PortHandler(device)
        assert theirs.openPort() and theirs.setBaudRate(1_000_000)
        packets = sdk.PacketHandler(0)
        for place in PLACES:
            assert packets.ping(theirs, place.servo_id)[:2] == (777, sdk.COMM_SUCCESS)
            for register, value in place.wanted().items():
                read = packets.read1ByteTxRx if register.size == 1 else packets.read2ByteTxRx
                assert read(theirs, place.servo_id, register.address) == (value, sdk.COMM_SUCCESS, 0), register.name
        theirs.closePort()
        controller = rustypot.Sts3215PyController(device, 1_000_000, 0.5)
        for place in PLACES:
            held = controller.read_id(place.servo_id), controller.read_p_coefficient(place.servo_id)
            assert held == ([place.servo_id], [dict(place.settings)["position_p"]])

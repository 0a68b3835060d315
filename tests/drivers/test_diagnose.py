"""Absent, alarmed, wrong baud and duplicate are told apart, on the real driver over a simulated line."""

from pathlib import Path

import pytest

from drivers.bus import ServoFault
from drivers.diagnose import diagnose
from drivers.feetech import sts
from drivers.feetech.bus import FeetechBus
from drivers.latency import latency_advice
from sim_backend.bus import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort
from sim_backend.rig import Rig
from sim_backend.servo import VirtualServo

IDS = (1, 2, 3, 4)


class Line:
    def __init__(self, servos: VirtualBus | None = None) -> None:
        self.clock = SimulatedClock(50.0)
        self.servos = servos or VirtualBus.of(BenchPlant(IDS))
        self.port = VirtualPort(self.servos, self.clock)
        self.bus = FeetechBus(self.port, self.clock)

    def said(self) -> dict[int, str]:
        return diagnose(self.bus, IDS)


def test_of_a_sound_line_nothing_is_said() -> None:
    assert Line().said() == {}


def test_an_absent_servo_answers_at_no_rate() -> None:
    line = Line()
    line.servos.faults.silence(3)
    said = line.said()
    assert said.keys() == {3}
    assert "does not answer at any baud rate" in said[3]
    assert line.port.baud == 1_000_000


@pytest.mark.parametrize("index", [1, 4, 5])
def test_a_servo_at_another_rate_is_found_there(index: int) -> None:
    line = Line()
    line.servos.servos[1].memory.put(sts.baud_rate, index)
    rate = sts.BAUD_RATES[index]
    assert f"servo 2: answers at {rate} baud" in line.said()[2]
    assert line.port.baud == 1_000_000


def test_two_servos_with_one_id_are_suspected() -> None:
    plant = BenchPlant((1, 2, 3, 4, 9))
    servos = [VirtualServo(sts.STS3215, coupling.servo_id) for coupling in plant.couplings]
    plant.place([0.0, 0.0, 0.0, 0.0, 1.0])
    double = VirtualBus(Rig(servos, plant))
    servos[-1].memory.put(sts.servo_id, 2)
    servos[-1].memory.put(sts.present_temperature, 55)
    line = Line(double)
    said = line.said()
    assert said.keys() == {2}
    assert "do two servos have ID 2?" in said[2]


def test_an_alarmed_servo_is_no_fault_of_the_line() -> None:
    line = Line()
    for servo in line.servos.servos:
        servo.memory.put(sts.min_voltage, 130)
        servo.firmware.load_settings()
    line.clock.sleep_until(51.0)
    assert line.said() == {}
    readings = line.bus.read_states(IDS)
    assert all(not isinstance(r, ServoFault) and "voltage" in r.alarms for r in readings.values())


def test_a_bad_line_is_called_bad() -> None:
    line = Line()
    line.servos.faults.disturbance = Disturbance(seed=3, flip=0.6)
    said = line.said()
    assert all("now and then" in text or "never in one piece" in text for text in said.values())


def test_a_slow_latency_timer_is_named_with_the_remedy(tmp_path: Path) -> None:
    timer = tmp_path / "ttyUSB7" / "device" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    advice = latency_advice("/dev/ttyUSB7", tmp_path)
    assert advice is not None
    assert "16 ms" in advice
    assert f"echo 1 | sudo tee {timer}" in advice


@pytest.mark.parametrize("content", ["1\n", "2\n", "", "?"])
def test_a_fast_or_unknown_timer_needs_no_word(tmp_path: Path, content: str) -> None:
    timer = tmp_path / "ttyUSB7" / "device" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(content)
    assert latency_advice("/dev/ttyUSB7", tmp_path) is None


def test_an_adapter_without_a_timer_needs_no_word(tmp_path: Path) -> None:
    assert latency_advice("/dev/ttyACM0", tmp_path) is None

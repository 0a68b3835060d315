"""Tests that the diagnosis distinguishes missing servos, alarms, wrong baud rates and duplicate IDs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import PortError, PortLost
from drivers.port.latency import latency_advice
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, xl320
from drivers.servos import x as x_series
from drivers.servos.register import ServoModel
from drivers.types import Reading, ServoFault
from hal.servos.diagnose import BAUD_RATES, TRIES, diagnose
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.line.rig import Rig
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo
from tests.drivers.ports import WatchedPort

IDS = (1, 2, 3, 4)


class Line:
    def __init__(self, servos: VirtualBus | None = None) -> None:
        self.clock = SimulatedClock(50.0)
        self.servos = servos or VirtualBus.of(BenchPlant(IDS))
        self.port = VirtualPort(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock)

    def diagnosis(self) -> dict[int, str]:
        return diagnose(self.bus, IDS)


def test_a_good_connection_yields_no_diagnosis() -> None:
    assert Line().diagnosis() == {}


def test_a_missing_servo_answers_at_no_baud_rate() -> None:
    line = Line()
    line.servos.faults.silence(3)
    texts = line.diagnosis()
    assert texts.keys() == {3}
    assert "does not respond at any baud rate" in texts[3]
    assert line.port.baud == 1_000_000


@pytest.mark.parametrize("index", [1, 4, 5])
def test_a_servo_at_another_baud_rate_is_found(index: int) -> None:
    line = Line()
    line.servos.servos[1].memory.put(sts.baud_rate, index)
    rate = sts.BAUD_RATES[index]
    assert f"servo 2: responds at {rate} baud" in line.diagnosis()[2]
    assert line.port.baud == 1_000_000


OF_PROTOCOL_1 = (1_000_000, 500_000, 400_000, 250_000, 200_000, 115_200, 57_600, 19_200, 9_600)
"""2 Mbit/s divided by 2, 4, 5, 8, 10, 17, 35, 104 and 208. For the last five rates, this list contains the usual
rounded values."""
OF_AN_MX = (2_250_000, 2_500_000, 3_000_000)
"""Baud rates of the register values to which the formula does not apply."""


@pytest.mark.parametrize("rates", [sts.BAUD_RATES, x_series.BAUD_RATES, xl320.BAUD_RATES, OF_PROTOCOL_1, OF_AN_MX])
def test_every_baud_rate_of_every_control_table_is_tried(rates: tuple[int, ...]) -> None:
    assert set(rates) - set(BAUD_RATES) == set()


@pytest.mark.parametrize(("value", "rate"), [(4, 400_000), (9, 200_000), (250, 2_250_000), (251, 2_500_000)])
def test_an_mx_at_a_rare_baud_rate_is_found(value: int, rate: int) -> None:
    clock = SimulatedClock(50.0)
    servos = VirtualBus.of(BenchPlant(IDS), dxl.MX_28)
    servos.servo(2).memory.put(dxl.baud_rate, value)
    bus = Bus(VirtualPort(servos, clock), clock, dict.fromkeys(IDS, dxl.MX_28))
    assert f"servo 2: responds at {rate} baud" in diagnose(bus, IDS)[2]


def test_an_x_series_servo_at_its_highest_baud_rate_is_found() -> None:
    clock = SimulatedClock(50.0)
    models = dict.fromkeys(IDS, x_series.XM430_W350)
    servos = VirtualDynamixelBus.of(BenchPlant(IDS), models)
    servos.servo(2).memory.put(x_series.baud_rate, x_series.BAUD_RATES.index(4_500_000))
    bus = Bus(VirtualPort(servos, clock), clock, models)
    assert "servo 2: responds at 4500000 baud" in diagnose(bus, IDS)[2]


def test_a_baud_rate_unknown_to_the_adapter_does_not_end_the_search() -> None:
    line = Line()
    line.servos.servos[1].memory.put(sts.baud_rate, sts.BAUD_RATES.index(38_400))
    set_baud = line.port.set_baud

    def only_slow(baud: int) -> None:
        if baud > 1_000_000:
            raise PortError(f"no {baud}")
        set_baud(baud)

    line.port.set_baud = only_slow  # type: ignore[method-assign]
    assert "servo 2: responds at 38400 baud" in line.diagnosis()[2]


def test_two_servos_with_the_same_id_are_suspected() -> None:
    plant = BenchPlant((1, 2, 3, 4, 9))
    servos = [VirtualServo(sts.STS3215, coupling.servo_id) for coupling in plant.couplings]
    plant.place([0.0, 0.0, 0.0, 0.0, 1.0])
    double = VirtualBus(Rig(servos, plant))
    servos[-1].memory.put(sts.servo_id, 2)
    servos[-1].memory.put(sts.present_temperature, 55)
    line = Line(double)
    texts = line.diagnosis()
    assert texts.keys() == {2}
    assert "do two servos have ID 2?" in texts[2]


# Late replies


class Held:
    """Three servos on an adapter that delays every reply."""

    def __init__(self, model: ServoModel, hold_s: float) -> None:
        self.clock = SimulatedClock(50.0)
        self.servos = VirtualBus.of(BenchPlant((1, 2, 3)), model)
        self.port = WatchedPort(self.servos, self.clock)
        self.port.hold_s = hold_s
        self.bus = Bus(self.port, self.clock, dict.fromkeys((1, 2, 3), model))

    def diagnosis(self, servo_ids: tuple[int, ...] = (1, 2, 3)) -> dict[int, str]:
        return diagnose(self.bus, servo_ids)


@pytest.mark.parametrize("hold_ms", [25, 30, 40, 60, 70, 80, 90, 120, 150, 200, 240])
@pytest.mark.parametrize("model", [sts.STS3215, scs.SCS0009, dxl.AX_12A, dxl.MX_28], ids=lambda model: model.name)
@pytest.mark.parametrize("servo_ids", [(1,), (1, 2, 3)])
def test_an_adapter_that_delays_replies_is_reported(
    model: ServoModel, hold_ms: int, servo_ids: tuple[int, ...]
) -> None:
    texts = Held(model, hold_ms / 1000.0).diagnosis(servo_ids)
    assert texts.keys() == set(servo_ids)
    for servo_id, text in texts.items():
        assert text.startswith(f"servo {servo_id}: responds too late: the adapter or a hub delays replies")


def test_a_late_reply_is_not_attributed_to_the_next_baud_rate() -> None:
    """The servos use 115200 baud, and the adapter is slow. A reply must not be counted for a later baud rate."""
    line = Held(sts.STS3215, 0.09)
    for servo in line.servos.servos:
        servo.memory.put(sts.baud_rate, sts.BAUD_RATES.index(500_000))
    assert not [text for text in line.diagnosis().values() if "responds at" in text and "500000" not in text]


def test_a_servo_that_starts_answering_is_not_attributed_to_another_baud_rate() -> None:
    line = Line()
    line.servos.faults.silence(2)
    seen: list[int] = []

    class Booting(Bus):
        def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
            seen.append(self.baud)
            if len(seen) == TRIES + 1:
                line.servos.faults.restore(2)
            return super().read_states(servo_ids, deadline_s)

    assert diagnose(Booting(line.port, line.clock), IDS) == {}


def test_the_search_ends_and_skips_the_baud_rate_of_the_bus() -> None:
    line = Line()
    line.servos.faults.silence(3)
    rates: list[int] = []
    set_baud = line.port.set_baud

    def noted(baud: int) -> None:
        rates.append(baud)
        set_baud(baud)

    line.port.set_baud = noted  # type: ignore[method-assign]
    begin_s = line.clock.now()
    line.diagnosis()
    assert rates[::2] == [rate for rate in BAUD_RATES if rate != 1_000_000]
    assert set(rates[1::2]) == {1_000_000}
    assert line.clock.now() - begin_s < 5.0


def test_a_bus_with_endless_noise_does_not_delay_the_search() -> None:
    class Chattering(VirtualPort):
        def read(self, size: int, deadline_s: float) -> bytes:
            self._clock.sleep_until(min(deadline_s, self._clock.now() + 0.001))
            return b"\x55"

    clock = SimulatedClock(50.0)
    bus = Bus(Chattering(VirtualBus.of(BenchPlant(IDS)), clock), clock)
    with bus.at_baud(57_600):
        pass
    assert clock.now() - 50.0 < 2.0


def test_a_port_lost_during_the_search_is_raised() -> None:
    line = Line()
    line.servos.faults.silence(3)

    def lose(baud: int) -> None:
        line.port.unplug()
        line.port.discard_input()

    line.port.set_baud = lose  # type: ignore[method-assign]
    with pytest.raises(PortLost):
        line.diagnosis()


def test_an_alarm_is_not_attributed_to_the_connection() -> None:
    line = Line()
    for servo in line.servos.servos:
        servo.memory.put(sts.min_voltage, 130)
    line.clock.sleep_until(51.0)
    assert line.diagnosis() == {}
    readings = line.bus.read_states(IDS)
    assert all(not isinstance(r, ServoFault) and "voltage" in r.alarms for r in readings.values())


SEEDS = range(20)


def disturbed(seed: int, drop: float, flip: float) -> tuple[dict[int, str], Disturbance]:
    """Return the diagnosis of a bus that drops and corrupts packets, and the readings."""
    line = Line()
    line.servos.faults.disturbance = done = Disturbance(seed, drop=drop, flip=flip)
    return line.diagnosis(), done


@pytest.mark.parametrize(("drop", "flip"), [(0.09, 0.0), (0.0, 0.09), (0.045, 0.045), (0.5, 0.0)])
def test_a_bad_connection_yields_no_diagnosis_if_each_servo_answers_once(drop: float, flip: float) -> None:
    """Without a diagnosis, the caller uses the message of ``intermittent_text``."""
    found = [disturbed(seed, drop, flip) for seed in SEEDS]
    assert [texts for texts, _ in found] == [{}] * len(SEEDS)
    # 16 replies for each bus.
    share = sum(done.done.total() for _, done in found) / (len(SEEDS) * TRIES * len(IDS))
    # Send more requests to a servo if its first reads were unclear.
    assert share == pytest.approx(drop + flip, abs=0.12)


def test_servos_whose_replies_were_all_corrupted_are_reported() -> None:
    found = [disturbed(seed, 0.0, 0.5) for seed in SEEDS]
    never = [{i for i in IDS if done.done["flip", i] == TRIES} for _, done in found]
    assert [texts.keys() for texts, _ in found] == never
    assert any(never)
    assert all(f"servo {i}: responds, but every reply is corrupted" in texts[i] for texts, _ in found for i in texts)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_connection_without_intact_replies_is_reported(seed: int) -> None:
    texts, _ = disturbed(seed, 0.5, 0.5)
    assert texts.keys() == set(IDS)
    for servo_id, text in texts.items():
        assert text.startswith(f"servo {servo_id}: responds") and "check the cable's plugs" in text
        assert "every reply is corrupted" in text or "with corrupted replies" in text


def test_a_connection_that_loses_replies_is_not_reported_as_slow() -> None:
    """A wrong diagnosis by chance happens for 3 or 4 of 1600 servos."""
    texts = [text for seed in range(60) for text in disturbed(seed, 0.5, 0.0)[0].values()]
    assert sum("too late" in text for text in texts) <= 2


def test_a_slow_latency_timer_is_reported_with_the_remedy(tmp_path: Path) -> None:
    timer = tmp_path / "ttyUSB7" / "device" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    advice = latency_advice("/dev/ttyUSB7", tmp_path)
    assert advice is not None
    assert "16 ms" in advice
    assert f"echo 1 | sudo tee {timer}" in advice


@pytest.mark.parametrize("content", ["1\n", "2\n", "", "?"])
def test_a_fast_or_unknown_latency_timer_is_not_reported(tmp_path: Path, content: str) -> None:
    timer = tmp_path / "ttyUSB7" / "device" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(content)
    assert latency_advice("/dev/ttyUSB7", tmp_path) is None


def test_an_adapter_without_a_latency_timer_is_not_reported(tmp_path: Path) -> None:
    assert latency_advice("/dev/ttyACM0", tmp_path) is None

"""The report: ranked findings and the figures that they come from."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from commissioning.doctor.checks.identity import firmware
from commissioning.doctor.finding import Finding
from commissioning.doctor.snapshot import BusSnapshot, LineFigures, ServoSnapshot, Snapshot, Stranger
from commissioning.ports.adapters import Adapter


@dataclass(frozen=True, slots=True)
class ServoFigures:
    """One servo in numbers; what is not known is None."""

    joint: str
    servo_id: int
    model: str
    heard: str
    firmware: str | None = None
    position: float | None = None
    """rad or m."""
    voltage_v: tuple[float, float] | None = None
    """The lowest and the highest at rest."""
    temperature_c: float | None = None
    load: float | None = None
    torque: bool | None = None
    alarms: tuple[str, ...] = ()
    registers: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BusFigures:
    """One line in numbers."""

    name: str
    port: str
    baud: int
    problem: str | None
    line: LineFigures | None
    servos: tuple[ServoFigures, ...]
    strangers: tuple[Stranger, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """``findings``: the likeliest root first."""

    findings: tuple[Finding, ...]
    buses: tuple[BusFigures, ...]
    adapters: tuple[str, ...] = ()
    """The machine's adapters: chip and USB numbers."""

    @property
    def healthy(self) -> bool:
        """Whether nothing keeps the arm from working: there may be warnings and notes."""
        return not any(finding.severity == "fault" for finding in self.findings)


def report_of(snapshot: Snapshot, findings: tuple[Finding, ...], adapters: Iterable[Adapter] = ()) -> Report:
    """The snapshot's figures beside the findings."""
    return Report(findings, tuple(_bus(bus) for bus in snapshot.buses), tuple(map(_adapter, adapters)))


def _adapter(adapter: Adapter) -> str:
    numbers = "" if adapter.vid is None else f", {adapter.vid:04x}:{adapter.pid:04x}"
    latency = "" if adapter.latency_ms is None else f", latency timer {adapter.latency_ms} ms"
    return f"{adapter.device}: {adapter.chip}{numbers}{latency}"


def _bus(bus: BusSnapshot) -> BusFigures:
    return BusFigures(
        bus.name, bus.port, bus.baud, bus.problem, bus.line, tuple(map(_servo, bus.servos)), bus.strangers
    )


def _servo(servo: ServoSnapshot) -> ServoFigures:
    joint = servo.joint
    if not servo.states:
        return ServoFigures(joint.name, joint.servo_id, joint.model.name, servo.heard)
    state, volts = servo.states[-1], [one.voltage_v for one in servo.states]
    return ServoFigures(
        joint.name,
        joint.servo_id,
        joint.model.name,
        servo.heard,
        firmware(servo),
        round(joint.position(state.position_counts), 4),
        (round(min(volts), 1), round(max(volts), 1)),
        state.temperature_c,
        round(state.load, 3),
        servo.holds,
        state.alarms,
        dict(servo.registers),
    )

"""A user's hardware component for tests: a mock that records its calls and fails on request.

The parameter ``orders`` in the URDF names a folder. A file in this folder whose name is that of a call of the component
contains an order. "lost" or "defect" makes the call raise an error while the file exists. "rest" makes the component
deactivate itself once, and a number delays one call by that number of seconds. The file ``pose`` displaces the first
joint at the next call, as if it was moved by hand.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from drivers.clock import Clock
from drivers.driver_errors import PortLost
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.robot_description.description import HardwareInfo
from hal.types import JointCommand, JointState

NAME = "acme/Gauge"
GONE = "/dev/gauge is gone"
DEFECT = "a defect of the gauge"
ROOT = Path(__file__).resolve().parents[2]


class Gauge(MockHardware):
    """Mock component. The state interfaces ``reads`` and ``writes`` of the first joint count these calls; ``calls``
    lists all other calls."""

    orders: Path

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self._reads = self._writes = 0

    def configure(self) -> None:
        self._note("configure")
        super().configure()

    def activate(self) -> None:
        self._note("activate")
        super().activate()

    def deactivate(self, relax: bool) -> Sequence[str]:
        self._note("deactivate")
        return super().deactivate(relax)

    def cleanup(self) -> None:
        self._note("cleanup")
        super().cleanup()

    def read(self) -> JointState:
        self._obey("read")
        self._reads += 1
        counts = {f"{self.joints[0]}/reads": self._reads, f"{self.joints[0]}/writes": self._writes}
        return replace(super().read(), extra=counts)

    def write(self, command: JointCommand) -> None:
        self._writes += 1
        super().write(command)
        self._obey("write")

    def _note(self, call: str) -> None:
        with (self.orders / "calls").open("a") as calls:
            calls.write(f"{call}\n")
        self._obey(call)

    def _obey(self, call: str) -> None:
        if (pose := self.orders / "pose").exists():
            self._position[0] = float(pose.read_text())
            pose.unlink()
        if not (order := self.orders / call).exists():
            return
        wanted = order.read_text()
        if wanted == "lost":
            raise PortLost(GONE)
        if wanted == "defect":
            raise RuntimeError(DEFECT)
        order.unlink()
        if wanted == "rest":
            self.state = LifecycleState.INACTIVE
        else:
            time.sleep(float(wanted))


def make(component: HardwareInfo, clock: Clock) -> Gauge:
    """Create the component. The entry point refers to this function."""
    made = Gauge.of(component, clock)
    assert isinstance(made, Gauge)
    made.orders = Path(component.parameters["orders"])
    return made


def install(site: Path) -> str:
    """Create the files of an installed package with this plugin, and return a PYTHONPATH that contains the package."""
    info = site / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[servoloop.hardware]\n{NAME} = {make.__module__}:make\n")
    return f"{site}:{ROOT}"


class Orders:
    """Controls one component from a test, through the folder of the component."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder

    @property
    def hardware(self) -> str:
        """Contents of ``<hardware>`` in the URDF."""
        return f'<plugin>{NAME}</plugin><param name="orders">{self.folder}</param>'

    @property
    def calls(self) -> list[str]:
        """Return all calls so far that change the state of the component."""
        return (self.folder / "calls").read_text().split()

    def give(self, call: str, wanted: str | float) -> None:
        """Write an order. The file is replaced atomically, because the component reads it in every cycle."""
        part = self.folder / f"{call}.part"
        part.write_text(str(wanted))
        part.replace(self.folder / call)

    def withdraw(self, *calls: str) -> None:
        for call in calls or ("read", "write", "configure", "activate", "deactivate", "cleanup"):
            (self.folder / call).unlink(missing_ok=True)

"""Simulated time for real clients, as used by ``servoloop up --rtf`` and ``--step``."""

from collections.abc import Callable, Mapping

from controller.loop import ControlLoop
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from drivers.port import Port
from hal.types import JointState
from servoloop.simulation.pace import POLL_S, Pace
from servoloop.stack import hardware
from servoloop.stack.background_worker import SameThreadWorker
from servoloop.stack.hardware import HardwareKind, HardwareSetup
from servoloop.stack.robot_files import Files
from servoloop.stack.ros_interface import RosInterface
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.clock import SimulatedClock


class SimulatedTime:
    """Simulated time, advanced by the loop thread.

    The loop runs each cycle as fast as possible, then waits for its clients and its pace.
    """

    def __init__(self, pace: Pace, build: Build) -> None:
        """``build`` describes the virtual servos."""
        self.clock = SimulatedClock()
        self.pace = pace
        self.worker = SameThreadWorker()
        self._build = build
        self._lines: VirtualLines | None = None
        self._loop: ControlLoop
        self._ros_nodes: RosInterface

    def hardware(
        self,
        kind: HardwareKind | None,
        ports: Mapping[str, str] | None,
        files: Files,
        tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
    ) -> HardwareSetup:
        """Build the hardware for simulated time without opening any device.

        Raises DriverError if a component could depend on real time.
        """
        if ports is not None:
            raise DriverError("real servos cannot run in simulated time: omit --port, or --rtf and --step")
        kinds = [hardware.choose(kind, component) for component in files.description.components]
        if users := [str(one) for one in kinds if not isinstance(one, HardwareKind)]:
            names = ", ".join(users)
            raise DriverError(f"{names} may not support simulated time: omit --rtf and --step, or set --hardware")
        if HardwareKind.SERVOS in kinds:
            self._lines = VirtualLines(files, self._build)
        devices = self._lines.devices if self._lines is not None else {}
        return hardware.build(kind, files, devices, self.clock, self._lines, tap)

    def connect(self, loop: ControlLoop, ros_nodes: RosInterface) -> None:
        """Connect the paced loop to the ROS interface that publishes the loop's states."""
        self._loop, self._ros_nodes = loop, ros_nodes
        self.pace.on_done = ros_nodes.wake
        loop.on_cycle = self._on_cycle

    def before_cycle(self, ended: Callable[[], bool]) -> None:
        """Wait in the loop thread until the next cycle may run or ``ended`` returns true."""
        while not (self._ros_nodes.wait_until_published(POLL_S) or ended()):
            pass
        self.pace.wait(self.clock.now(), lambda: self._serve() or ended())

    def _on_cycle(self, state: JointState) -> None:
        if self._lines is not None:
            self._lines.advance(self.clock.now())
        self._ros_nodes.post(state)

    def _serve(self) -> bool:
        """Serve requests while the simulation is paused, so that clients can load controllers before the first step."""
        if self.pace.paused and self._loop.requests.inbox:
            self._loop.requests.serve()
            self._ros_nodes.wake()
        return False

"""A virtual SO-101 on a simulated clock, to which a stand-in of ros2_control's plugin sends commands in every
cycle."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from controller.host.host_controller import HostController
from controller.interface import limits_of
from hal.types import FloatArray, JointState
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from tests.topic_host.plugin import Message, TopicSystem

RATE_HZ = 100
PERIOD_S = 1.0 / RATE_HZ


@dataclass
class HostRig:
    """The arm, the plugin and the program that commands it."""

    wanted: Callable[[float], Mapping[str, float]]
    """Commands (rad) of the program's controllers at a given time in seconds, by joint."""
    reaches: Callable[[float], bool] = lambda time_s: True
    """Whether a message that is sent at a given time reaches the arm."""
    passes: Callable[[float, Message], Message] = lambda time_s, message: message
    """Function that changes a message on its way."""
    commands: list[FloatArray] = field(default_factory=list)
    """Commands (n,) that the safety gate has passed, one per cycle, in rad."""
    refused: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        files = read_arm_files(find_arm("so101"), None, None, None)
        files = replace(files, controllers=replace(files.controllers, update_rate_hz=RATE_HZ))
        self.stack = stack = SimulatedStack(files=files)
        for name in list(stack.manager.registry.loaded):
            stack.manager.registry.unload(name)
        self.joints = tuple(name.partition("/")[0] for name in stack.loop.hardware.command_interfaces)
        limits = limits_of(self.joints, files.limits)
        self.limits = limits
        self.controller = HostController("host", self.joints, limits, stack.loop.hardware.joints)
        stack.manager.registry.add(self.controller)
        self.plugin = TopicSystem(self.joints)
        self.messages = 0
        stack.on_state = self._on_state

    def _on_state(self, state: JointState) -> None:
        now_s = self.stack.clock.now()
        self.commands.append(self.stack.loop.command.copy())
        if not state.faults:
            self.plugin.read(self.stack.loop.hardware.joints, state.position.tolist())
        self.plugin.commands = dict(self.wanted(now_s))
        if (message := self.plugin.write()) is not None and self.reaches(now_s):
            message = self.passes(now_s, message)
            self.messages += 1
            try:
                self.controller.submit(message.name, message.position)
            except ValueError as error:
                self.refused.append(str(error))

    @property
    def path(self) -> FloatArray:
        """Commands of all cycles (k, n), in rad."""
        return np.array(self.commands)

    def check_motion(self) -> None:
        """Assert that no command leaves the limits of position, velocity and acceleration."""
        path = self.path
        assert np.isfinite(path).all()
        lower, upper = (np.array([getattr(one, end) for one in self.limits]) for end in ("lower", "upper"))
        assert (path >= lower - 1e-9).all() and (path <= upper + 1e-9).all()
        for order, bound in ((1, "velocity"), (2, "acceleration")):
            largest = np.abs(np.diff(path, order, axis=0)).max(axis=0) / PERIOD_S**order
            assert (largest <= 1.001 * np.array([getattr(one, bound) for one in self.limits])).all(), (bound, largest)

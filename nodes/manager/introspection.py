"""Publish the hardware interfaces and the loop times, as ros2_control does with pal_statistics.

PlotJuggler can plot these topics. A cycle is published only if there is a subscriber.
"""

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from builtin_interfaces.msg import Time
from pal_statistics_msgs.msg import Statistic, Statistics, StatisticsNames, StatisticsValues
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from controller.broadcasters.state_values import reader
from controller.loop_figures import LoopFigures
from hal.robot_description.description import Mimic
from hal.types import JointState
from nodes.stack import Stack

INTERFACES: Final = "~/introspection_data"
TIMES: Final = "~/statistics"
EVERY_CYCLE: Final = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL)
"""QoS profile that pal_statistics uses for values."""
NAMES: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS profile for the names topic, so that late subscribers also receive the names."""
VERSION: Final = 1
"""Version of the names, which do not change while the stack runs."""
PARTS: Final = ("max", "min", "average", "standard_deviation", "sample_count")
MICROSECONDS: Final = 1e6


class _Topics:
    """The topics ``full``, ``names`` and ``values`` for one list of variables."""

    def __init__(self, node: Node, topic: str, names: Sequence[str]) -> None:
        self._full = node.create_publisher(Statistics, f"{topic}/full", EVERY_CYCLE)
        self._values = node.create_publisher(StatisticsValues, f"{topic}/values", EVERY_CYCLE)
        self._names = node.create_publisher(StatisticsNames, f"{topic}/names", NAMES)
        self._all = Statistics(statistics=[Statistic(name=name) for name in names])
        message = StatisticsNames(names=list(names), names_version=VERSION)
        message.header.stamp = node.get_clock().now().to_msg()
        self._names.publish(message)

    def publish(self, values: Callable[[], Sequence[float]], stamp: Time) -> None:
        """Publish values in the same order as the names. The values are computed only if there is a subscriber."""
        full, alone = self._full.get_subscription_count(), self._values.get_subscription_count()
        if not full and not alone:
            return
        found = values()
        if alone:
            message = StatisticsValues(values=array("d", found), names_version=VERSION)
            message.header.stamp = stamp
            self._values.publish(message)
        if full:
            for variable, value in zip(self._all.statistics, found, strict=True):
                variable.value = value
            self._all.header.stamp = stamp
            self._full.publish(self._all)


@dataclass(slots=True)
class RunningFigure:
    """Maximum, minimum, mean, standard deviation and number of all values so far."""

    count: int = 0
    highest: float = math.nan
    lowest: float = math.nan
    mean: float = 0.0
    _squares: float = 0.0

    def add(self, value: float) -> None:
        """Add a value, using Welford's method."""
        self.count += 1
        self.highest = value if self.count == 1 else max(self.highest, value)
        self.lowest = value if self.count == 1 else min(self.lowest, value)
        away = value - self.mean
        self.mean += away / self.count
        self._squares += away * (value - self.mean)

    @property
    def parts(self) -> tuple[float, ...]:
        """The values in the order of ``PARTS``."""
        deviation = math.sqrt(self._squares / self.count) if self.count else math.nan
        return self.highest, self.lowest, self.mean if self.count else math.nan, deviation, float(self.count)


class LoopTimes:
    """Times of the control loop: the execution and read times in µs, and the rate in Hz."""

    names = tuple(f"controller_manager.{what}" for what in ("total_time", "read_time", "periodicity"))

    def __init__(self) -> None:
        self._figures = {name: RunningFigure() for name in self.names}
        self._last_s: float | None = None

    def add(self, figures: LoopFigures, stamp_s: float) -> None:
        """Add a cycle."""
        values = [figures.last_busy_s * MICROSECONDS, figures.last_read_s * MICROSECONDS]
        if self._last_s is not None and stamp_s > self._last_s:
            values.append(1.0 / (stamp_s - self._last_s))
        self._last_s = stamp_s
        for figure, value in zip(self._figures.values(), values, strict=False):
            figure.add(value)

    @property
    def variables(self) -> list[str]:
        """Names of all variables."""
        return [f"{name}/{part}" for name in self.names for part in PARTS]

    def values(self) -> list[float]:
        """Return the values of ``variables``."""
        return [value for figure in self._figures.values() for value in figure.parts]


class Introspection:
    """The two lists of variables of one stack. Only one thread may use this object."""

    def __init__(self, node: Node, stack: Stack) -> None:
        self._stack = stack
        component, joints = stack.component, stack.loop.hardware.joints
        mimics = {name: joint.mimic for name, joint in stack.description.joints.items() if name in component.mimics}
        sources = {name: Mimic(one.joint, 1.0, 0.0) for name, one in component.sensors.items() if one.joint}
        pairs = [name.rpartition("/")[::2] for name in component.states]
        self._read = [reader(joint, kind, joints, mimics.get(joint) or sources.get(joint)) for joint, kind in pairs]
        self._outputs = stack.factory.context.outputs
        commands = (*stack.loop.hardware.command_interfaces, *self._outputs.infos)
        names = [f"state_interface.{name}" for name in component.states]
        self._interfaces = _Topics(node, INTERFACES, [*names, *(f"command_interface.{name}" for name in commands)])
        self._times = LoopTimes()
        self._statistics = _Topics(node, TIMES, self._times.variables)

    def publish(self, state: JointState, stamp: Time) -> None:
        """Publish a cycle."""
        self._interfaces.publish(lambda: self._values(state), stamp)
        self._times.add(self._stack.loop.figures, state.stamp_s)
        self._statistics.publish(self._times.values, stamp)

    def _values(self, state: JointState) -> list[float]:
        commands = (*self._stack.loop.command.tolist(), *self._outputs.values.values())
        return [*(read(state) for read in self._read), *commands]

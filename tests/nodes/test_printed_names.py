"""Names that clients and files send are cut and on one line in every message of the nodes."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("rclpy")

from lifecycle_msgs.msg import State

from drivers.printable import LONGEST_LINE, printable_line
from nodes.manager.hardware_services import HardwareServices
from nodes.pick_place.node import PickPlaceNode

WILD = "arm\nERROR all is well\x1b[2J" + "x" * 1_000_000
SPARE = 100
"""Characters that a message has beside the name."""


class Log:
    """Stands for a node's logger."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def error(self, text: str, **_: Any) -> None:
        self.said.append(text)

    info = warning = error


def fits(said: list[str]) -> None:
    assert said
    for text in said:
        assert len(text) <= LONGEST_LINE + SPARE
        assert "\n" not in text and "\x1b" not in text and "\\n" in text


def test_a_line_is_one_line() -> None:
    assert printable_line("a\nb\x1b[2J\t") == "a\\nb\\x1b[2J\t"


def services(log: Log) -> Any:
    made = cast(Any, HardwareServices.__new__(HardwareServices))
    made._node = SimpleNamespace(get_logger=lambda: log)
    return made


def test_a_state_that_hardware_does_not_know() -> None:
    log = Log()
    services(log)._refuse(SimpleNamespace(name=WILD, target_state=State(label=WILD)))
    fits(log.said)


def test_a_component_that_does_not_exist() -> None:
    log = Log()
    made = services(log)
    made._stack = SimpleNamespace(loop=SimpleNamespace(hardware=SimpleNamespace(component=lambda name: None)))
    request = SimpleNamespace(name=WILD, target_state=State(id=3))
    with pytest.raises(StopIteration):
        made._set_state(request, SimpleNamespace(ok=True)).send(None)
    fits(log.said)


def test_a_grade_that_pick_and_place_does_not_know() -> None:
    log = Log()
    node = cast(Any, PickPlaceNode.__new__(PickPlaceNode))
    node._log, node._reason_to_reject = log, lambda grade: f"unknown grade {grade}"
    node._on_goal(SimpleNamespace(grade=WILD))
    fits(log.said)

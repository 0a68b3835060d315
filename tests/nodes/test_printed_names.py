"""Messages show names from clients and files in shortened form and on one line."""

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
"""Maximum number of characters in a message, not counting the name."""


class Log:
    """Fake logger of a node."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def error(self, text: str, **_: Any) -> None:
        self.messages.append(text)

    info = warning = error


def fits(messages: list[str]) -> None:
    assert messages
    for text in messages:
        assert len(text) <= LONGEST_LINE + SPARE
        assert "\n" not in text and "\x1b" not in text and "\\n" in text


def test_line_breaks_are_escaped() -> None:
    assert printable_line("a\nb\x1b[2J\t") == "a\\nb\\x1b[2J\t"


def services(log: Log) -> Any:
    made = cast(Any, HardwareServices.__new__(HardwareServices))
    made._node = SimpleNamespace(get_logger=lambda: log)
    return made


def test_unknown_hardware_state_is_printed_safely() -> None:
    log = Log()
    services(log)._refuse(SimpleNamespace(name=WILD, target_state=State(label=WILD)))
    fits(log.messages)


def test_unknown_component_is_printed_safely() -> None:
    log = Log()
    made = services(log)
    made._stack = SimpleNamespace(loop=SimpleNamespace(hardware=SimpleNamespace(component=lambda name: None)))
    request = SimpleNamespace(name=WILD, target_state=State(id=3))
    with pytest.raises(StopIteration):
        made._set_state(request, SimpleNamespace(ok=True)).send(None)
    fits(log.messages)


def test_unknown_grade_is_printed_safely() -> None:
    log = Log()
    node = cast(Any, PickPlaceNode.__new__(PickPlaceNode))
    node._log, node._reason_to_reject = log, lambda grade: f"unknown grade {grade}"
    node._on_goal(SimpleNamespace(grade=WILD))
    fits(log.messages)

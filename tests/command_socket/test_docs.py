"""docs/socket.md names all messages, errors and limits, and its Python example runs."""

from collections.abc import Iterator

import pytest

from servoloop.command_server import requests, server, session
from servoloop.command_socket import messages
from servoloop.command_socket.command_errors import KINDS
from tests.command_socket.rig import SocketRig, served
from tests.pages import DOCS, code

PAGE = "socket.md"
TEXT = " ".join((DOCS / PAGE).read_text().split())


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    with served(monkeypatch) as rig:
        yield rig


def test_all_messages_and_errors_are_listed() -> None:
    for op in messages.OPS:
        assert f"| `{op}` |" in TEXT
    for kind, meaning in KINDS.items():
        assert f"| `{kind}` | {meaning} |" in TEXT


def test_figures_match_the_code() -> None:
    assert f"of at most {messages.MAX_LINE_BYTES:,} bytes" in TEXT and f"At most {server.MAX_CLIENTS} clients" in TEXT
    assert f"older than {requests.STALE_S} s" in TEXT and f"than {session.MESSAGES_PER_S:,.0f} messages" in TEXT
    assert f"when {session.MAX_UNREAD_BYTES:,} bytes wait" in TEXT
    assert f"which is {messages.VERSION};" in TEXT


@pytest.mark.runs("socket.md python 1")
def test_the_example_moves_the_hand(rig: SocketRig, capsys: pytest.CaptureFixture[str]) -> None:
    exec(code(PAGE, "python"), {})
    assert "'joint1': " in capsys.readouterr().out

"""Keyboard input of commands: lines that arrive together or in pieces, and signals at any prompt."""

import io
import os
import sys
import termios
from collections.abc import Callable, Iterator

import pytest

from commissioning.calibrate.by_hand import CalibrationTask
from commissioning.calibrate.run import STORE, TRY
from commissioning.set_up.flow import SetUpTask
from commissioning.slow_arm import StoppedError
from servoloop.commands.output.calibrate_terminal import Terminal
from servoloop.commands.set_up import Plugger
from servoloop.commands.shared.console import Keyboard
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from tests.servoloop.served import eventually


class Typing:
    """Standard input with simulated typing."""

    def __init__(self) -> None:
        self.there, self._here = os.pipe()

    def type(self, text: str) -> None:
        os.write(self._here, text.encode())

    def end(self) -> None:
        os.close(self._here)


@pytest.fixture
def typing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Typing]:
    typing = Typing()
    with os.fdopen(typing.there) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield typing


def test_several_lines_in_one_read_are_returned_one_by_one(typing: Typing) -> None:
    keyboard = Keyboard(Signals())
    typing.type("one\n\nthr")
    assert (keyboard.next_line(), keyboard.next_line(), keyboard.line()) == ("one", "", None)
    typing.type("ee\n")
    assert keyboard.next_line() == "three"


def test_yes_no_and_invalid_answers(typing: Typing, capsys: pytest.CaptureFixture[str]) -> None:
    keyboard = Keyboard(Signals())
    typing.type("y\nN\n\nperhaps\nYes\n")
    assert [keyboard.agrees("Well?") for _ in range(4)] == [True, False, False, True]
    assert capsys.readouterr().err.count("Well? [y/N]: ") == 5


def test_the_end_of_the_input_is_not_an_answer(typing: Typing) -> None:
    typing.end()
    with pytest.raises(Interrupted, match="the input has ended: nothing was stored"):
        Terminal(Signals(), yes=False).confirm(STORE)


PROMPTS = {
    "store": lambda signals: Terminal(signals, yes=False).confirm(STORE),
    "moved so": lambda signals: Terminal(signals, yes=True).moved_so("joint1", "to the left"),
    "until done": lambda signals: Terminal(signals, False).until_done(  # type: ignore[arg-type]
        CalibrationTask("sweep", "Move", (), None), lambda: None
    ),
    "connect": lambda signals: Plugger(signals).connect(SetUpTask("one", "Connect the gripper")),
}


@pytest.mark.parametrize("prompt", PROMPTS)
def test_a_signal_ends_every_prompt_whatever_is_typed(typing: Typing, prompt: str) -> None:
    signals = Signals()
    typing.type("y\n")
    signals.ask()
    with pytest.raises(Interrupted, match="interrupted"):
        PROMPTS[prompt](signals)


def test_after_storing_an_interruption_does_not_report_that_nothing_was_stored(typing: Typing) -> None:
    signals = Signals()
    terminal = Terminal(signals, yes=False)
    typing.type("y\n")
    assert terminal.confirm(STORE)
    signals.ask()
    with pytest.raises(Interrupted, match="the calibration is stored"):
        terminal.confirm(TRY)


class Screen(io.StringIO):
    """Output that types an answer when a question appears."""

    def __init__(self, answer: Callable[[], object]) -> None:
        super().__init__()
        self._answer = answer

    def write(self, text: str) -> int:
        if "]: " in text:
            self._answer()
        return super().write(text)


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Return the controlling end of a pseudo-terminal that is used as standard input."""
    master, slave = os.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield master
        os.close(master)


def settings() -> list[object]:
    return termios.tcgetattr(sys.stdin.fileno())


def test_any_key_stops_and_the_terminal_is_restored(master: int) -> None:
    before = settings()
    with Terminal(Signals(), yes=False) as terminal:
        assert not terminal.stopped()
        os.write(master, b"x")
        eventually(terminal.stopped)
    assert settings() == before


def test_a_key_pressed_before_the_first_motion_stops_it(master: int) -> None:
    os.write(master, b"x")
    with Terminal(Signals(), yes=False) as terminal:
        eventually(terminal.stopped)


def test_a_key_pressed_after_the_motion_is_a_stop_and_not_an_answer(master: int) -> None:
    with Terminal(Signals(), yes=False) as terminal:
        assert not terminal.stopped()
        os.write(master, b"\n")
        eventually(terminal.stopped)
        with pytest.raises(StoppedError, match="stopped"):
            terminal.moved_so("joint1", "to the left")


def test_a_question_ignores_keys_typed_before_it(master: int, monkeypatch: pytest.MonkeyPatch) -> None:
    before, keyboard = settings(), Keyboard(Signals())
    assert not keyboard.pressed()
    os.write(master, b"n\n")
    eventually(keyboard.pressed)
    monkeypatch.setattr(sys, "stderr", Screen(lambda: os.write(master, b"y\n")))
    assert keyboard.agrees("Well?") and settings() == before


def test_enter_alone_does_not_answer_the_question_about_the_direction(
    typing: Typing, capsys: pytest.CaptureFixture[str]
) -> None:
    typing.type("\nn\n\ny\n")
    terminal = Terminal(Signals(), yes=True)
    assert [terminal.moved_so("joint1", "to the left") for _ in range(2)] == [False, True]
    assert capsys.readouterr().err.count("[y/n]: ") == 4


def test_a_terminal_that_is_gone_stops_the_motion_and_gives_no_answer(master: int) -> None:
    with Terminal(Signals(), yes=False) as terminal:
        assert not terminal.stopped()
        os.dup2(os.open(os.devnull, os.O_RDONLY), master)
        assert terminal.stopped()
        with pytest.raises(Interrupted, match="the input has ended: nothing was stored"):
            terminal.confirm(STORE)

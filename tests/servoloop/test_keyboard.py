"""What a person types to a tool: lines that come at once or in pieces, and a signal at any prompt."""

import os
import sys
from collections.abc import Iterator

import pytest

from commissioning.calibrate.flow import Task
from commissioning.calibrate.run import STORE, TRY
from commissioning.set_up.flow import Task as Connect
from servoloop.processes import Interrupted
from servoloop.signals import Signals
from servoloop.verbs.keyboard import Keyboard
from servoloop.verbs.set_up import Plugger
from servoloop.verbs.terminal import Terminal


class Typing:
    """Standard input, into which somebody types."""

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


def test_lines_that_came_at_once_are_lines(typing: Typing) -> None:
    keyboard = Keyboard(Signals())
    typing.type("one\n\nthr")
    assert (keyboard.next_line(), keyboard.next_line(), keyboard.line()) == ("one", "", None)
    typing.type("ee\n")
    assert keyboard.next_line() == "three"


def test_yes_no_and_what_is_neither(typing: Typing, capsys: pytest.CaptureFixture[str]) -> None:
    keyboard = Keyboard(Signals())
    typing.type("y\nN\n\nperhaps\nYes\n")
    assert [keyboard.agrees("Well?") for _ in range(4)] == [True, False, False, True]
    assert capsys.readouterr().err.count("Well? [y/N]: ") == 5


def test_the_end_of_the_input_is_no_answer(typing: Typing) -> None:
    typing.end()
    with pytest.raises(Interrupted, match="the input has ended: nothing was stored"):
        Terminal(Signals(), yes=False).confirm(STORE)


PROMPTS = {
    "store": lambda signals: Terminal(signals, yes=False).confirm(STORE),
    "moved so": lambda signals: Terminal(signals, yes=True).moved_so("joint1", "to the left"),
    "until done": lambda signals: Terminal(signals, False).until_done(Task("sweep", "Move", (), None), lambda: None),  # type: ignore[arg-type]
    "connect": lambda signals: Plugger(signals).connect(Connect("one", "Connect the gripper")),
}


@pytest.mark.parametrize("prompt", PROMPTS)
def test_a_signal_ends_every_prompt_whatever_is_typed(typing: Typing, prompt: str) -> None:
    signals = Signals()
    typing.type("y\n")
    signals.ask()
    with pytest.raises(Interrupted, match="interrupted"):
        PROMPTS[prompt](signals)


def test_behind_the_storing_nobody_is_told_that_nothing_was_stored(typing: Typing) -> None:
    signals = Signals()
    terminal = Terminal(signals, yes=False)
    typing.type("y\n")
    assert terminal.confirm(STORE)
    signals.ask()
    with pytest.raises(Interrupted, match="the calibration is stored"):
        terminal.confirm(TRY)

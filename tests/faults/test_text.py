"""Faults as text, YAML and events are equivalent, and all mistakes are reported at once."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.servos.sts import STS3215
from sim_backend.faults.event import Event
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.script import read_script, script_text
from sim_backend.faults.servos import Silent
from sim_backend.faults.targets import Inventory
from sim_backend.faults.text import parse, text_of
from tests.faults.strategies import events


@given(events())
def test_an_event_and_its_text_are_the_same(event: Event) -> None:
    assert parse(text_of(event)) == event


@settings(max_examples=50)
@given(st.text(min_size=1, max_size=20))
def test_line_names_can_have_any_characters(name: str) -> None:
    event = Silent(servo_id=3, bus=name)
    assert parse(text_of(event)) == event


@settings(max_examples=50)
@given(st.lists(events(), max_size=5))
def test_events_and_their_file_are_the_same(tmp_path_factory: pytest.TempPathFactory, listed: list[Event]) -> None:
    path = tmp_path_factory.mktemp("faults") / "faults.yaml"
    path.write_text(script_text(listed))
    assert read_script(path) == tuple(listed)


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("silent id=3 for=2s", Silent(servo_id=3, for_s=2.0)),
        ("silent for=200ms id=3 at=1", Silent(servo_id=3, for_s=0.2, at_s=1.0)),
        ("  silent   id=3 bus='left arm'", Silent(servo_id=3, bus="left arm")),
    ],
)
def test_a_text_is_parsed(text: str, event: Event) -> None:
    assert parse(text) == event


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ["there is no fault ''"]),
        ("sillent id=3", ["did you mean silent?"]),
        ("silent", ["id: is missing", "silent id=ID"]),
        ("silent 3", ["3: silent has only the parameters id=, bus=, at=, since=, for="]),
        (
            "silent id=three fr=2 at=-1s",
            ["id: must be a whole number, not 'three'", "fr=2: silent has only the parameters", "at: must be"],
        ),
        ("silent id=3 id=4", ["id=4: id is given twice"]),
        ("silent id=3 for=0s", ["for: must be above 0"]),
        ("silent id=3 for=nans", ["for: must be a finite number"]),
        ("silent id=3 'for=2", ["no closing quotation"]),
        ("brown_out id=3 for=1s", ["for=1s: brown_out has only the parameters id=, bus=, boot=, at="]),
        ("weak_supply", ["a weak supply needs voltage_v, resistance_ohm, or both"]),
        ("slipped_horn id=3 counts=0", ["counts: a slip of 0 counts has no effect"]),
        ("adapter_unplugged as=ttyACM1", ["needs for_s"]),
        ("adapter_unplugged for=1s as=", ["as: must not be empty: omit it to keep the name of the adapter"]),
        ("lost_replies chance=1.5", ["chance: must be at most 1, not '1.5'"]),
        ("overload id=1 torque=10000", ["torque: must be -100 to 100 N m, not"]),
    ],
)
def test_all_mistakes_of_a_text_are_reported(text: str, said: list[str]) -> None:
    with pytest.raises(FaultError) as refused:
        parse(text)
    for each in said:
        assert each in str(refused.value)


def test_all_mistakes_of_a_file_are_reported_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text("- {kind: silent, servo_id: 3, for: 2}\n- kind: hot\n- kind: hott\n  servo_id: 1\n")
    with pytest.raises(FaultError) as refused:
        read_script(path)
    assert [line.split(": ")[0] for line in str(refused.value).splitlines()] == [f"{path}:{n}" for n in (1, 2, 3)]


@pytest.mark.parametrize("name", ["/dev/ttyACM1", "folder/bus", ".", ".."])
def test_an_emulator_refuses_a_new_name_outside_its_folder(name: str) -> None:
    event = parse(f"adapter_unplugged for=1s as={name}")
    event.refuse(Inventory({"": {1: STS3215}}))
    with pytest.raises(FaultError, match=f"set `as` to a file name, such as another, not '{name}'"):
        event.refuse(Inventory({"": {1: STS3215}}, stack=False))


@pytest.mark.parametrize("content", ["", "silent", "{kind: silent}", "- [silent]"])
def test_a_file_without_a_list_of_faults_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(content)
    with pytest.raises(FaultError, match=str(path)):
        read_script(path)


def test_every_kind_has_a_description() -> None:
    assert all(kind.__doc__ and kind.__doc__.strip().endswith(".") for kind in KINDS.values())

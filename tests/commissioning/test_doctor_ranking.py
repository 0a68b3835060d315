"""Findings are ranked by their most likely cause. A cause hides only the findings that result from it."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commissioning.doctor.doctor import judge
from commissioning.doctor.findings import KINDS, SEVERITIES, Finding, FindingPlace, finding, ranked
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, Heard, LineFigures, ServoSnapshot
from drivers.types import ServoState
from tests.commissioning.patient import files_of

JOINTS = files_of("robot_arm").robot.joints

PLACES = st.builds(
    FindingPlace,
    st.sampled_from([None, "", "hand"]),
    st.none(),
    st.one_of(st.none(), st.integers(min_value=1, max_value=3)),
)
FINDINGS = st.lists(
    st.builds(finding, st.sampled_from(sorted(KINDS)), PLACES, st.just("symptom"), st.just("cause")), max_size=12
)


@given(FINDINGS)
def test_the_most_likely_cause_is_first_and_only_consequences_are_hidden(found: list[Finding]) -> None:
    kept = ranked(found, KINDS)
    assert [one.rank for one in kept] == sorted((one.rank for one in kept), reverse=True)
    assert set(kept) <= set(found)
    for one in set(found) - set(kept):
        assert any(one.id in KINDS[by.id].explains and by.place.covers(one.place) for by in found)
    assert bool(kept) == bool(found)


@given(FINDINGS)
def test_a_fault_is_hidden_only_by_another_fault(found: list[Finding]) -> None:
    assert any(one.severity == "fault" for one in ranked(found, KINDS)) == any(one.severity == "fault" for one in found)


@given(FINDINGS, st.randoms(use_true_random=False))
def test_the_order_of_the_checks_does_not_matter(found: list[Finding], random: object) -> None:
    mixed = list(found)
    random.shuffle(mixed)  # type: ignore[attr-defined]
    assert ranked(mixed, KINDS) == ranked(found, KINDS)


def test_kinds_explain_only_less_likely_and_less_severe_kinds() -> None:
    for name, kind in KINDS.items():
        for other in kind.explains:
            assert KINDS[other].rank < kind.rank, (name, other)
            assert SEVERITIES.index(kind.severity) <= SEVERITIES.index(KINDS[other].severity), (name, other)


STATES = st.builds(
    ServoState,
    st.integers(-40_000, 40_000),
    st.integers(-5000, 5000),
    st.floats(-1.0, 1.0),
    st.floats(0.0, 25.5),
    st.floats(0.0, 255.0),
    st.lists(st.sampled_from(["overload", "voltage", "temperature", "current", "unknown (bit 6)"])).map(tuple),
)
NAMES = sorted({"model_number", "position_p", "torque_enable", "torque_limit", "max_torque", "lock", "status_level",
                "min_position", "max_position", "homing_offset", "operating_mode", "phase", "unloading_condition",
                "min_voltage", "max_voltage", "max_temperature", "firmware_major", "firmware_minor"})  # fmt: skip
REGISTERS = st.dictionaries(st.sampled_from(NAMES), st.one_of(st.integers(0, 255), st.just(777)))
HEARD: list[Heard] = ["well", "unsteady", "broken", "late", "mute", "silent"]


@st.composite
def snapshots(draw: st.DrawFn) -> ArmSnapshot:
    servos = []
    for joint in JOINTS:
        heard = draw(st.sampled_from(HEARD))
        states = tuple(draw(st.lists(STATES, min_size=1, max_size=3))) if heard in ("well", "unsteady") else ()
        registers = draw(REGISTERS) if states else {}
        elsewhere = draw(st.sampled_from([None, None, 500_000])) if heard == "silent" else None
        wanted = replace(joint, homing_offset=draw(st.sampled_from([None, 0, 12])))
        servos.append(ServoSnapshot(wanted, heard, registers, states, "port", elsewhere))
    line = LineFigures(
        draw(st.integers(0, 700)), *(draw(st.integers(0, 20)) for _ in range(4)), draw(st.floats(0.0, 0.1)), 0.00015
    )
    return ArmSnapshot((BusSnapshot("", "/dev/ttyACM0", 1_000_000, tuple(servos), (), line),))


@given(snapshots())
def test_any_snapshot_is_judged_without_an_exception(snapshot: ArmSnapshot) -> None:
    for one in judge(snapshot):
        assert one.symptom and one.cause
        assert KINDS[one.id].severity == one.severity


@pytest.mark.parametrize("count", range(1, len(JOINTS)))
def test_silent_servos_are_named_or_explained_by_one_cause(count: int) -> None:
    """Every silent servo is named by its own finding or by the finding that explains it."""
    servos = tuple(
        ServoSnapshot(joint, "silent" if at < count else "well", {}, () if at < count else (STATE,))
        for at, joint in enumerate(JOINTS)
    )
    found = judge(ArmSnapshot((BusSnapshot("", "port", 1_000_000, servos),)))
    assert {one.place.servo_id for one in found if one.id == "servo_absent"} == set(range(1, count + 1))


STATE = ServoState(2048, 0, 0.0, 12.0, 30.0)

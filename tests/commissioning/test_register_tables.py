"""The command ``register tables`` lists models and control tables without a servo."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.servos.catalog import MODELS, model_advice
from tests.commissioning.served import run
from tests.hal.user_models import GOOD, forgotten

Listed = Callable[..., list[dict[str, object]]]


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    with forgotten():
        yield


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Listed:
    """Run the command and return what it lists."""

    def run_with(*arguments: str) -> list[dict[str, object]]:
        assert run(monkeypatch, "register", "tables", *arguments, "--json") == 0
        found: list[dict[str, object]] = json.loads(capsys.readouterr().out)
        return found

    return run_with


def test_all_models_are_listed(listed: Listed) -> None:
    models = listed()
    assert sorted(str(one["name"]) for one in models) == sorted(MODELS)
    assert {one["source"] for one in models} == {"servoloop"}


def test_a_table_has_the_values_and_units_of_its_registers(listed: Listed) -> None:
    table = {one["name"]: one for one in listed("xl430-w250")}
    assert table["max_voltage_limit"] == {
        "name": "max_voltage_limit", "address": 32, "size": 2, "writable": True, "persistent": True,
        "values": "60 to 140", "unit": "V",
    }  # fmt: skip
    assert (table["operating_mode"]["values"], table["present_load"]["values"]) == ("1, 3, 4 or 16", "")


def test_models_of_the_present_folder_are_listed(
    listed: Listed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "servo_models.yaml").write_text(GOOD)
    monkeypatch.chdir(tmp_path)
    sources = {one["name"]: one["source"] for one in listed()}
    assert sources["sts3046"] == "servo_models.yaml"
    assert "external_port_mode_1" in [one["name"] for one in listed("my-xm540")]


def test_an_unknown_model_gets_similar_names(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "register", "tables", "sts3216") == 1
    assert "unknown servo model sts3216: use one of sts3215" in capsys.readouterr().err


def test_an_unknown_model_gets_few_names() -> None:
    assert model_advice("sts9999").count(",") <= 2
    assert model_advice("\u4f1d" * 9) == "'servoloop register tables' lists all models"


def test_a_mistake_in_the_file_of_the_present_folder_is_reported_with_its_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "servo_models.yaml").write_text("sts3046:\n  like: sts9999\n  number: 1545\n")
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "register", "tables") == 1
    assert "servo_models.yaml:2: unknown model sts9999: use one of" in " ".join(capsys.readouterr().err.split())

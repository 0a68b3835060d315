"""The virtual Dynamixels are compared with the facts about real Dynamixels."""

import pytest

from benchmarks import dynamixel_fidelity
from benchmarks.facts.dynamixel_facts import Fact


def test_the_virtual_dynamixels_agree_with_every_fact(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        dynamixel_fidelity.main()
    printed = capsys.readouterr().out
    assert ended.value.code == 0, printed
    assert "errors" in printed and "profiles" in printed


def test_a_fact_that_does_not_agree_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    right, wrong = Fact("modes", "mode 1", 1.0, 1.01), Fact("errors", "led 5", 4, 0)
    monkeypatch.setattr(dynamixel_fidelity, "facts", lambda: [right, wrong])
    with pytest.raises(SystemExit) as ended:
        dynamixel_fidelity.main()
    printed = capsys.readouterr().out
    assert ended.value.code == 1
    assert "errors: led 5: 0 instead of 4 (E)" in printed and "1 of 2" in printed

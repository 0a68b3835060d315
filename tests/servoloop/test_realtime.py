"""What is asked of the system for those who must be on time."""

import logging
import os
from pathlib import Path

import pytest

from servoloop.realtime import WAKE_LATENCY, processors_awake


def test_the_request_is_four_bytes_of_no_latency_and_ends_with_the_scope(tmp_path: Path) -> None:
    device = tmp_path / "latency"
    device.touch()
    before = set(os.listdir("/proc/self/fd"))
    with pytest.raises(ZeroDivisionError), processors_awake(device) as granted:
        assert granted
        assert device.read_bytes() == b"\0\0\0\0"
        assert len(os.listdir("/proc/self/fd")) == len(before) + 1
        raise ZeroDivisionError
    assert set(os.listdir("/proc/self/fd")) == before


def test_the_kernel_takes_it() -> None:
    if not os.access(WAKE_LATENCY, os.R_OK | os.W_OK):
        pytest.skip(f"no right to open {WAKE_LATENCY}")
    with processors_awake() as granted:
        assert granted
        assert WAKE_LATENCY.open("rb").read(4) == bytes(4)


def test_where_it_is_not_granted_the_work_is_done_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    done = False
    with caplog.at_level(logging.WARNING), processors_awake(tmp_path / "none") as granted:
        assert not granted
        done = True
    assert done
    assert "processors may sleep" in caplog.text and "none" in caplog.text

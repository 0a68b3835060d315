"""A patch of rclpy is used only with a supported version, and only if its checks find no difference."""

import ctypes
import logging
import sys
from collections.abc import Iterable
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service

import nodes.rclpy_patches
from nodes.rclpy_patches import cycle_executor, gil_release, guard, rcl_calls, type_service
from nodes.rclpy_patches.guard import PATCHES, rclpy_version, select, usable_patches
from nodes.rclpy_patches.patch import Patch

KNOWN = "7.1.5"


def other_version() -> Iterable[str]:
    raise AssertionError("looked into an rclpy of a version that is not known")


def lost(monkeypatch: pytest.MonkeyPatch, patch: Patch) -> str:
    """Check that only this patch does not fit the installed rclpy, and return the warning."""
    usable, warning = select(PATCHES, KNOWN)
    assert usable == frozenset(PATCHES) - {patch}
    assert patch.loss in warning and not any(other.loss in warning for other in usable)
    return warning


def test_all_patches_fit_the_installed_rclpy() -> None:
    assert select(PATCHES, rclpy_version()) == (frozenset(PATCHES), "")


@pytest.mark.parametrize("version", ["7.1.4", "7.1.9", "7.1.50", "9.1.2", ""])
def test_unknown_version_uses_no_patch_and_one_warning_lists_the_limitations(version: str) -> None:
    patches = [Patch(name, frozenset({KNOWN}), f"no {name}", other_version) for name in ("speed", "calm")]
    usable, warning = select(patches, version)
    assert not usable
    assert warning.startswith(
        f"rclpy {version or 'of unknown version'} is not supported (supported: {KNOWN}): the stack uses plain rclpy"
    )
    assert warning.endswith("has the following limitations: no speed; no calm")
    assert warning.count("not supported") == 1


@pytest.mark.parametrize(("owner", "name"), [("Publisher", "publish"), ("ActionServer", "send_goal_response")])
def test_missing_or_different_method_disables_the_patch(owner: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = getattr(rclpy_implementation, owner)
    monkeypatch.setattr(kind, name, type("Other", (), {"__doc__": f"{name}(self: {owner}) -> None\n\nSend."})())
    assert f"{owner}.{name} is (self: {owner}) -> None instead of (self: " in lost(monkeypatch, gil_release.PATCH)
    monkeypatch.delattr(kind, name)
    assert f"{owner}.{name} is missing instead of (self: " in lost(monkeypatch, gil_release.PATCH)


def test_different_parameters_of_send_response_disable_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Service, "send_response", lambda self, response: None)
    assert "Service.send_response has parameters different from" in lost(monkeypatch, gil_release.PATCH)


def test_different_layout_disables_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    assert rcl_calls.written_by_zero_initialized_goal_statuses() == ctypes.sizeof(rcl_calls.GoalStatuses) == 64

    class Longer(rcl_calls.GoalStatuses):
        _fields_ = (("more", ctypes.c_void_p),)

    monkeypatch.setattr(rcl_calls, "GoalStatuses", Longer)
    assert "rcl_action_goal_status_array_t has 64 bytes instead of 72" in lost(monkeypatch, gil_release.PATCH)


def test_missing_structure_field_disables_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(rclpy_implementation.rmw_request_id_t, "sequence_number")
    assert "rmw_request_id_t has no sequence_number" in lost(monkeypatch, gil_release.PATCH)


def test_missing_c_libraries_disable_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> Any:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.delitem(sys.modules, "nodes.rclpy_patches.rcl_calls")
    monkeypatch.delattr(nodes.rclpy_patches, "rcl_calls")
    monkeypatch.setattr(ctypes, "CDLL", refuse)
    usable, warning = select(PATCHES, KNOWN)
    assert usable == {cycle_executor.PATCH}
    assert "gil_release cannot be used on this rclpy: librcl.so: cannot open shared object file" in warning
    assert gil_release.PATCH.loss in warning and type_service.PATCH.loss in warning


@pytest.mark.parametrize("name", ["_take_service", "_take_waitable"])
def test_missing_take_method_disables_the_patch(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(Executor, name)
    assert f"SingleThreadedExecutor has no {name}" in lost(monkeypatch, cycle_executor.PATCH)


def test_different_tasks_of_the_executor_disable_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    def made(self: Any) -> None:
        self._context = self._guard = self._sigint_gc = self._pending_tasks = self._tasks_lock = None

    def handler(self: Any, entity: Any, node: Any, take_from_wait_list: Any) -> None:
        self._pending_tasks = {}

    monkeypatch.setattr(Executor, "__init__", made)
    monkeypatch.setattr(Executor, "_make_handler", handler)
    warning = lost(monkeypatch, cycle_executor.PATCH)
    assert "Executor has no _tasks, Executor._make_handler creates tasks differently" in warning


def test_different_guard_condition_disables_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GuardCondition, "__init__", lambda self: None)
    assert "GuardCondition has no _executor_triggered" in lost(monkeypatch, cycle_executor.PATCH)


def test_different_wait_set_disables_the_patch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rclpy_implementation.WaitSet, "__init__", lambda self: None)
    assert "WaitSet takes different arguments" in lost(monkeypatch, cycle_executor.PATCH)


def test_process_logs_the_warning_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(guard, "rclpy_version", lambda: "7.1.99")
    usable_patches.cache_clear()
    try:
        with caplog.at_level(logging.WARNING, "servoloop.nodes"):
            assert usable_patches() == usable_patches() == frozenset()
    finally:
        usable_patches.cache_clear()
    assert [record.getMessage().partition(" (")[0] for record in caplog.records] == ["rclpy 7.1.99 is not supported"]

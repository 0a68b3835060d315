"""Settings of the pick-and-place node and their configuration file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from pick_place.settings import JobSettings

CONFIG = Path(__file__).parents[2] / "config" / "vision_pick_place_controller.yaml"


def test_configuration_file_equals_the_defaults() -> None:
    given: dict[str, Any] = yaml.safe_load(CONFIG.read_text())
    parameters = given["/**/vision_pick_place_controller"]["ros__parameters"]
    default = JobSettings()
    assert parameters.pop("pick_place_action_name") == "sorting/arm/pick_place"
    assert parameters.pop("auto_goal_from_vision") is True
    assert parameters.pop("motion") == "joints"
    assert tuple(parameters.pop("joints")) == default.joints
    poses = parameters.pop("poses")
    assert (tuple(poses["ready"]), tuple(poses["pick"])) == (default.ready_rad, default.pick_rad)
    bins = parameters.pop("bins")
    assert parameters.pop("grades") == list(bins) == list(default.bins_rad)
    assert {grade: tuple(pose) for grade, pose in bins.items()} == default.bins_rad
    assert parameters == {name: getattr(default, name) for name in parameters}
    assert len(parameters) == 10  # six times, two gripper positions and two controllers


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joints": ()}, "joints is empty"),
        ({"pick_rad": (0.0,)}, "poses.pick has 1 numbers for 6 joints"),
        ({"ready_rad": (float("nan"),) * 6}, "poses.ready contains a number that is not finite"),
        ({"bins_rad": {"D": (0.0,) * 5}}, "bins.D has 5 numbers"),
        ({"bins_rad": {"d ": (0.0,) * 6}}, "write 'D'"),
        ({"move_time_s": 0.0}, "move_time_s is 0.0"),
        ({"result_timeout_s": float("inf")}, "result_timeout_s is inf"),
        ({"hand_closed_m": float("nan")}, "hand_closed_m must be"),
    ],
)
def test_invalid_setting_is_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(JobSettings(), **change)


def test_all_mistakes_are_named_together() -> None:
    with pytest.raises(ValueError, match=r"pick.*; move_time_s"):
        replace(JobSettings(), pick_rad=(), move_time_s=-1.0)


def test_implausible_pose_is_refused() -> None:
    with pytest.raises(ValueError, match=r"poses.pick: must be -2000 to 2000 rad or m, not 1e\+30"):
        replace(JobSettings(), pick_rad=(1e30, 0.0, 0.0, 0.0, 0.0, 0.0))

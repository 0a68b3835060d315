"""Settings of ROS that end in one sentence instead of an error of rcl."""

import os
from pathlib import Path

import pytest

from drivers.errors import DriverError
from nodes.ros_environment import check_environment


def test_good_settings_pass(tmp_path: Path) -> None:
    for settings in ({"HOME": str(tmp_path)}, {"ROS_LOG_DIR": str(tmp_path / "a" / "b")}, {"ROS_HOME": str(tmp_path)}):
        check_environment({**settings, "ROS_DOMAIN_ID": "232"})
        check_environment(settings)
    assert (tmp_path / "a" / "b").is_dir() and (tmp_path / ".ros" / "log").is_dir()


@pytest.mark.parametrize("domain", ["233", "-1", "abc", "1.5", "1 2"])
def test_a_domain_outside_its_range_is_refused(tmp_path: Path, domain: str) -> None:
    with pytest.raises(DriverError, match=f"ROS_DOMAIN_ID is '{domain}': set it to a whole number from 0 to 232"):
        check_environment({"HOME": str(tmp_path), "ROS_DOMAIN_ID": domain})


def test_no_home_is_told() -> None:
    with pytest.raises(DriverError, match=r"HOME is not set.*set HOME or ROS_LOG_DIR"):
        check_environment({})


@pytest.mark.parametrize("variable", ["ROS_LOG_DIR", "HOME"])
def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, variable: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DriverError, match=r"ROS cannot write its logs into .*: set ROS_LOG_DIR"):
        check_environment({variable: str(tmp_path / "file")})


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_told(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(DriverError, match="set ROS_LOG_DIR"):
        check_environment({"ROS_LOG_DIR": str(tmp_path)})

"""Tests that docs/getting-started-so101.md and its images agree with the programs and the files of the arm."""

import re

import mujoco
import numpy as np
import pytest

from commissioning.registers.tables import rates_of
from drivers.servos.sts import STS3215, STS3215_C001
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from sim_backend.mechanics.motor import sts_motor
from tests.pages import pages
from tools.guide_pictures import CUBE_M, PICTURES, TIPS

TEXT = pages()["getting-started-so101.md"].read_text()
STEPS = re.split(r"^## (?=\d)", TEXT.partition("\n## The same")[0], flags=re.MULTILINE)[1:]


def test_each_step_describes_its_success_and_has_a_picture_if_possible() -> None:
    assert [step[0] for step in STEPS] == ["1", "2", "3", "4", "5"]
    assert all("**It worked** if" in step for step in STEPS)
    assert [step[0] for step in STEPS if "![" not in step] == ["4"], "whose result is text"
    assert {name for step in STEPS for name in re.findall(r"\(so101/(\w+)\.png\)", step)} == set(PICTURES)


def test_the_page_lists_the_baud_rates_that_setup_searches() -> None:
    listed = re.findall(r"\b\d{1,3}(?:,\d{3})+\b", STEPS[1])
    assert {int(rate.replace(",", "")) for rate in listed} == set(rates_of(STS3215_C001).values())


def test_the_page_gives_the_current_of_a_blocked_servo() -> None:
    said = re.search(r"blocked takes up to ([\d.]+) A", " ".join(TEXT.split()))
    stalled = [model.rated_voltage_v / sts_motor(model).resistance_ohm for model in (STS3215, STS3215_C001)]
    assert said and float(said[1]) == pytest.approx(max(stalled), abs=0.05)


def test_the_points_of_the_pictures_are_on_the_arm_and_the_cube_is_on_its_stand() -> None:
    arm = find_arm("so101")
    assert {link for link, _ in TIPS.values()} <= set(read_arm_servos(arm).description.links)
    scene = mujoco.MjModel.from_xml_path(str(arm.scene))
    np.testing.assert_allclose(scene.body("cube").pos, CUBE_M)

"""Compile the simulation ahead of its first use. `make setup` runs ``python -m sim_backend.compile_ahead``."""

from dataclasses import replace
from typing import Final

import mujoco
import numpy as np

from sim_backend.apples.apple import Spot, draw_apple
from sim_backend.buses.feetech import VirtualBus
from sim_backend.camera.light import Light
from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.camera.table import AppleTable, LyingApple, render
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.scene.mujoco_hardware import drive
from sim_backend.scene.picture import View

PICTURED: Final = """<mujoco><worldbody>
<light pos="0 0 2"/><camera name="overview" pos="0 0 1"/><geom type="plane" size="1 1 1"/>
</worldbody></mujoco>"""
"""Smallest scene that can be rendered.

The scene is not in a file, because some tests run in a partial copy of this project.
"""


def compile_ahead() -> None:
    """Call every compiled function once, so that its machine code is cached next to the sources."""
    line = VirtualBus.of(BenchPlant([1]))
    line.rig.step()
    line.servo(1).firmware.step(0.001, 0.0, 0.0)
    one, none = np.zeros(1), np.zeros(1, dtype=np.int64)
    drive(one, one, one, one, none, none, none, one, one, 0.0, one, one, one)
    model = mujoco.MjModel.from_xml_string(PICTURED)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    View(model, data, width=4, height=3).picture(data)
    apple = draw_apple(0)
    camera = PinholeCamera.looking_at(np.zeros(3), np.array([-0.25, 0.0, 0.55]), focal_px=10.0, size=(8, 6))
    spotted = replace(apple, spots=(Spot((0.0, 0.0, 1.0), 0.3, dark=True),))
    render(AppleTable([LyingApple(spotted, 0.0, 0.0)], smooth=False), camera, Light(), seed=0)


if __name__ == "__main__":
    compile_ahead()

"""Apples in a MuJoCo scene: spheres of different sizes that replace the cube.

A scene for apples declares their diameters: ``<custom><numeric name="apple_diameter_m" data="0.05 0.06"/></custom>``.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import mujoco

from hal.hal_errors import ArmFileError
from sim_backend.apples.apple import Apple, draw_apple
from sim_backend.arm_names import ARMS

DIAMETERS: Final = "apple_diameter_m"
"""Name of the scene element that contains the smallest and largest apple diameters, in meters."""
DENSITY_KG_M3: Final = 850.0
FRICTION: Final = (0.8, 0.01, 0.002)
"""Coefficient of sliding friction, and torsional and rolling friction in meters. The rolling friction accounts for
the imperfect roundness of an apple."""
STAND_FRICTION: Final = (0.2, 0.005, 0.004)
"""Friction on the stand. Rolling friction determines how far from the center of the stand an apple can come to rest."""
ALL_FRICTION: Final = 6
"""MuJoCo's contact dimension (``condim``) that includes rolling friction."""
BIN_RGBA: Final = (0.80, 0.80, 0.78, 1.0)
"""Color of the bins. Against a gray background, a camera can distinguish apples in any light."""


def apple_diameters_mm(spec: Any, scene: Path) -> tuple[float, float]:
    """Return the smallest and the largest diameter.

    Raises ArmFileError if the scene does not declare diameters, or if it has several arms.
    """
    if any(text.name == ARMS for text in spec.texts):
        raise ArmFileError(f"{scene}: apples need a scene with one arm, such as robot_arm or so101")
    found = [numeric.data for numeric in spec.numerics if numeric.name == DIAMETERS]
    if not found or len(found[0]) != 2 or not 0.0 < found[0][0] <= found[0][1]:
        raise ArmFileError(
            f'{scene}: the scene has no apples: add <custom><numeric name="{DIAMETERS}" data="SMALLEST LARGEST"/>'
            "</custom>, in meters, or use the arm robot_arm or so101"
        )
    return 1000.0 * float(found[0][0]), 1000.0 * float(found[0][1])


def apple_of_tray(seed: int, number: int, diameters_mm: tuple[float, float]) -> Apple:
    """Return the apple with this number, counted from 0. The seed defines the sequence of apples. The height equals the
    diameter, because apples are spheres in the simulated world."""
    return replace(draw_apple(seed * 1_000_003 + number, diameters_mm), height=1.0)


def replace_cube(spec: Any, diameters_mm: tuple[float, float]) -> None:
    """Replace the cube of a scene with a sphere of mean size, and adapt the stand and the bins to apples."""
    radius_m = 0.0005 * sum(diameters_mm) / 2.0
    sphere = spec.geom("cube")
    sphere.type = mujoco.mjtGeom.mjGEOM_SPHERE
    sphere.size = [radius_m, 0.0, 0.0]
    sphere.friction, sphere.condim = FRICTION, ALL_FRICTION
    sphere.mass = apple_mass_kg(radius_m)
    stand = spec.geom("stand")
    stand.friction, stand.condim = STAND_FRICTION, ALL_FRICTION
    for body in spec.bodies:
        if body.name.startswith("bin_"):
            for geom in body.geoms:
                geom.rgba = BIN_RGBA


def apple_mass_kg(radius_m: float) -> float:
    """Return the mass of an apple."""
    return DENSITY_KG_M3 * 4.0 / 3.0 * 3.141592653589793 * radius_m**3


def resize(model: Any, radius_m: float) -> None:
    """Change the apple's size and mass in a compiled model."""
    geom, body = model.geom("cube").id, model.body("cube").id
    dofs = slice(model.body_dofadr[body], model.body_dofadr[body] + 6)
    mass_kg = apple_mass_kg(radius_m)
    inertia_kg_m2 = 0.4 * mass_kg * radius_m**2
    model.geom_size[geom, 0] = model.geom_rbound[geom] = radius_m
    model.geom_aabb[geom, 3:] = radius_m
    model.body_mass[body] = model.body_subtreemass[body] = mass_kg
    model.body_inertia[body] = inertia_kg_m2
    # MuJoCo derives these constants from the mass of a free body.
    model.body_invweight0[body] = 1.0 / mass_kg, 1.0 / inertia_kg_m2
    model.dof_invweight0[dofs] = [1.0 / mass_kg] * 3 + [1.0 / inertia_kg_m2] * 3
    model.dof_M0[dofs] = [mass_kg] * 3 + [inertia_kg_m2] * 3

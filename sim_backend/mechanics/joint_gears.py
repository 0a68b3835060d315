"""Identified gears in a MuJoCo model. The friction of these gears depends on the torque through them in the last
timestep.

MuJoCo treats friction as a constraint with a maximum torque. Therefore, friction holds a joint but never reverses it,
for any timestep. This module only updates the maximum torque before each step.
"""

from collections.abc import Mapping
from typing import Any, Final

import mujoco
import numpy as np

from sim_backend.mechanics.gears import Gears, gear_table, renew_friction

LEAST_FRICTION_NM: Final = 1e-9
"""Minimum friction. MuJoCo does not create a constraint for a joint without friction, which would shift the indices of
the other constraints."""
FRICTION_ROW: Final = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
"""Numeric constraint type for the friction of a degree of freedom. NumPy compares numbers faster than enums."""


class JointGears:
    """Updater of the friction of some degrees of freedom in a model."""

    def __init__(self, model: Any, data: Any, gears: Mapping[int, Gears], before: "JointGears | None" = None) -> None:
        """Apply ``gears``, keyed by degree of freedom. Other degrees of freedom keep the gears of ``before``, an
        earlier updater."""
        self._model, self._data = model, data
        self._gears: dict[int, Gears] = {**(before._gears if before else {}), **gears}
        self._dofs = np.array(sorted(self._gears))
        self._table = gear_table(self._gears[dof] for dof in sorted(self._gears))
        self._friction = np.zeros(len(self._dofs))
        for dof, own in self._gears.items():
            model.dof_armature[dof] = own.rotor_kg_m2
            model.dof_damping[dof] = own.viscous_nm_s
        # This call sets the friction at rest, and loads the compiled code before the first timestep.
        renew_friction(self._table, self._friction.copy(), self._friction.copy(), LEAST_FRICTION_NM, self._friction)
        model.dof_frictionloss[self._dofs] = self._friction
        mujoco.mj_setConst(model, mujoco.MjData(model))  # Update the constants that depend on inertias.
        mujoco.mj_forward(model, data)

    def update(self) -> None:
        """Update the maximum friction from the torques of the last timestep."""
        dofs, data = self._dofs, self._data
        motor = data.qfrc_actuator[dofs]
        world = data.qfrc_constraint[dofs] - self._friction_now() - data.qfrc_bias[dofs]
        renew_friction(self._table, motor - world, data.qvel[dofs], LEAST_FRICTION_NM, self._friction)
        self._model.dof_frictionloss[dofs] = self._friction

    def _friction_now(self) -> Any:
        """Return the part of the constraint forces that is due to friction, for each degree of freedom. This part is
        subtracted, because friction must not depend on itself."""
        data = self._data
        rows = slice(data.ne, data.ne + data.nf)
        share = np.zeros(self._model.nv)
        joints = data.efc_type[rows] == FRICTION_ROW
        share[data.efc_id[rows][joints]] = data.efc_force[rows][joints]
        return share[self._dofs]

"""A controller for the wrist that keeps the pitch of the hand while shoulder and elbow move."""

import numpy as np

from controller.interface import ControllerContext, limits_of
from controller.parameters import Parameters


class LevelHandParameters(Parameters):
    wrist: str
    others: list[str]  # Joints whose axes are parallel to that of the wrist.

    def claims(self):
        return (f"{self.wrist}/position",)


class LevelHand:
    kind = "level_hand/LevelHand"
    parameters_type = LevelHandParameters
    settable = frozenset()

    def __init__(self, name, parameters, limits, joints):
        self.name, self.parameters, self.limits = name, parameters, limits
        self.command_interfaces = parameters.claims()
        self.state_interfaces = tuple(f"{joint}/position" for joint in (*parameters.others, parameters.wrist))
        self.command = np.full(1, np.nan)
        self.others = [joints.index(joint) for joint in parameters.others]

    @classmethod
    def build(cls, name, parameters, context: ControllerContext):
        limits = limits_of([parameters.wrist], context.limits)[0]
        return cls(name, parameters, limits, context.component.joints)

    def activate(self, state, command):
        self.command = command
        self.turned = 0.0  # Rotation of shoulder and elbow since activation, in rad.
        self.start = command

    def deactivate(self, reason=""): ...

    def update(self, state, now_s, period_s):
        self.turned += state.velocity[self.others].sum() * period_s
        self.command = np.clip(self.start - self.turned, self.limits.lower, self.limits.upper)

    def settled(self):
        return True

    def reconfigure(self, parameters):
        self.parameters = parameters

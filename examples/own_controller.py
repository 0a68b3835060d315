"""Let your own controller drive a joint, once per cycle of the loop. Run: python own_controller.py [PORT]"""

import math
import sys

import numpy as np

from controller.parameters import Parameters
from servoloop import Arm


class SwingParameters(Parameters):
    joint: str
    amplitude: float = 0.15  # rad

    def claims(self):
        return (f"{self.joint}/position",)


class Swing:
    kind = "example/Swing"
    parameters_type = SwingParameters

    def __init__(self, name, parameters):
        self.name, self.parameters = name, parameters
        self.command_interfaces = self.state_interfaces = parameters.claims()
        self.command = np.full(1, np.nan)

    @classmethod
    def build(cls, name, parameters, context):
        return cls(name, parameters)

    def activate(self, state, command):
        self.center, self.begun_s, self.command = command, state.stamp_s, command

    def deactivate(self, reason=""): ...

    def update(self, state, now_s, period_s):
        self.command = self.center + self.parameters.amplitude * math.sin(2.0 * (now_s - self.begun_s))

    def settled(self):
        return True


def main(arm: Arm) -> None:
    arm.move_to({"wrist_roll": 0.0}, duration=2.0)
    with arm.controller(Swing, joint="wrist_roll", amplitude=0.2):
        arm.sleep(5.0)
    arm.move_to({"wrist_roll": 0.0})  # the arm's own controllers continue to run


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:
        main(so101)

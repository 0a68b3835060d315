"""Check the command interfaces claimed by a controller."""

from collections.abc import Iterator

from controller.parameters import Parameters
from hal.robot_description.description import HardwareInfo
from hal.types import Interface


def claim_mistakes(parameters: Parameters, component: HardwareInfo) -> Iterator[tuple[str, str]]:
    """Check that the URDF contains each claimed command interface and that no interface is claimed twice.

    Yields the name of the invalid parameter and a description of the error.
    """
    joints, claims = component.joints, parameters.claims()
    key = "joint" if "joint" in type(parameters).model_fields else "joints"
    block = "the URDF's <ros2_control> block"
    for claim in dict.fromkeys(claims):
        joint = Interface.parse(claim).joint
        if claim in component.outputs:
            continue
        if joint not in joints:
            yield key, f"names {joint}, which has no command_interface in {block} (the block has {', '.join(joints)})"
        elif claim not in component.commands:
            yield key, f"needs {claim}, which is not a command_interface in {block}"
    for claim in sorted({claim for claim in claims if claims.count(claim) > 1}):
        yield key, f"names {Interface.parse(claim).joint} twice"

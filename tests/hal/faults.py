"""Texts of the faults in a joint state."""

from hal.types import JointState


def fault_texts(state: JointState) -> dict[str, str]:
    """Return the text of each fault, by joint name."""
    return {joint: fault.text for joint, fault in state.faults.items()}

"""What the faults of a state say."""

from hal.types import JointState


def fault_texts(state: JointState) -> dict[str, str]:
    """By joint."""
    return {joint: fault.text for joint, fault in state.faults.items()}

"""Options of the teleoperator type ``servoloop``."""

from dataclasses import dataclass, field

from lerobot.teleoperators import TeleoperatorConfig

from lerobot_servoloop.arm import SO_JOINTS


@TeleoperatorConfig.register_subclass("servoloop")
@dataclass
class ServoloopTeleoperatorConfig(TeleoperatorConfig):
    """Options of a leader arm that a running ``servoloop up`` reads."""

    arm: str | None = None
    """Name of the arm, its folder, or the process ID of the stack. None selects the only running stack."""
    namespace: str | None = None
    """ROS namespace of the stack, as in ``servoloop up --namespace``; empty for the root namespace. None selects any
    namespace."""
    joints: list[str] = field(default_factory=lambda: list(SO_JOINTS))
    """Joints whose positions form the action."""
    use_degrees: bool = True
    """Whether the values of joints are in degrees instead of -100 to 100. The value of the gripper is from 0 (closed)
    to 100 (open)."""
    release_torque: bool = True
    """Whether the leader moves to its park pose and releases its torque when LeRobot connects, so that you can move it
    by hand."""

"""Options of the robot type ``servoloop``."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from lerobot_servoloop.arm import SO_JOINTS


@RobotConfig.register_subclass("servoloop")
@dataclass
class ServoloopRobotConfig(RobotConfig):
    """Options of a robot that a running ``servoloop up`` moves."""

    arm: str | None = None
    """Name of the arm, its folder, or the process ID of the stack. None selects the only running stack."""
    namespace: str | None = None
    """ROS namespace of the stack, as in ``servoloop up --namespace``; empty for the root namespace. None selects any
    namespace."""
    joints: list[str] = field(default_factory=lambda: list(SO_JOINTS))
    """Joints that LeRobot reads and moves."""
    use_degrees: bool = True
    """Whether the values of joints are in degrees instead of -100 to 100. The value of the gripper is from 0 (closed)
    to 100 (open)."""
    max_relative_target: float | dict[str, float] | None = None
    """Maximum difference between an action and the measured position, for all joints or keyed by joint name."""
    max_age_s: float = 1.0
    """Time without actions after which the arm holds its position, in seconds."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    """Cameras, as for every LeRobot robot."""

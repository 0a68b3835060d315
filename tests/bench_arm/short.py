"""``python -m tests.bench_arm.short VERB …``: servoloop with a bench of one joint's motion and two goals."""

from collections.abc import Mapping

from hal.types import JointLimits
from servoloop.arms.pick_place import PickPlace
from servoloop.bench_arm import ros_run, run, slow
from servoloop.cli import main


def first_poses(pick_place: PickPlace, limits: Mapping[str, JointLimits]) -> list[slow.Pose]:
    """The ready pose, one joint beside it, and the ready pose again."""
    return slow.bench_poses(pick_place, limits)[:3]


if __name__ == "__main__":
    ros_run.GOALS, ros_run.LISTEN_S = 2, 1.0  # type: ignore[misc]
    run.bench_poses = first_poses
    main()

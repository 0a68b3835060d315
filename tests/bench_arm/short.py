"""``python -m tests.bench_arm.short VERB …``: run servoloop with a short bench of one joint and two goals."""

from collections.abc import Iterable, Mapping

from hal.types import JointLimits
from servoloop.bench import arm as run
from servoloop.bench import motion as slow
from servoloop.bench import ros as ros_run
from servoloop.cli import main
from servoloop.stack.pick_place import PickPlace


def first_poses(jobs: Iterable[PickPlace], limits: Mapping[str, JointLimits]) -> list[slow.Pose]:
    """Return the ready pose, a pose with one joint moved, and the ready pose again."""
    return slow.bench_poses(jobs, limits)[:3]


if __name__ == "__main__":
    ros_run.GOALS, ros_run.LISTEN_S = 2, 1.0  # type: ignore[misc]
    run.bench_poses = first_poses  # type: ignore[attr-defined]
    main()

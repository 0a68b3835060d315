"""Measure the planner: ``python -m benchmarks.planning [DATA] [--problems 30] [--poses 60]``.

DATA is a folder that contains problems.tar.bz2 (scenes and requests from MotionBenchMaker), ur5_spherized.urdf and
ur5.srdf. A problem is valid if the arm is not in contact at its start or its goal. MuJoCo's own collision detection,
with ten poses per 0.05 rad, counts the plans with contacts.

With ``--roboplan PYTHON``, roboplan plans the same problems for comparison. The times do not include scene
construction. With ``--poses``, arms of this project plan to random tool poses instead.
"""

import argparse
from pathlib import Path
from typing import Final

from rich.console import Console

from benchmarks.planning.peer import Peer
from benchmarks.planning.poses import run_poses
from benchmarks.planning.problems import JOINTS, LIMIT, plain, read_problems
from benchmarks.planning.ur5 import Results, run, table_of
from benchmarks.shared.arguments import in_words, positive
from planning.arm_model import ArmModel
from planning.collision import warm_up
from planning.paths.planner import SEARCHES
from planning.srdf_file import read_pairs

ARMS: Final = ("so101", "robot_arm")
"""Arms that plan motions to poses."""


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", help="folder of the problems")
    parser.add_argument("--problems", type=positive, default=30, help="number of problems, drawn evenly from all sets")
    parser.add_argument("--limit", type=float, default=5.0, help="time limit per problem, in seconds")
    parser.add_argument("--searches", type=positive, default=SEARCHES, help="searches for each problem")
    parser.add_argument(
        "--poses",
        type=positive,
        default=0,
        help="number of reachable poses; two poses out of reach are added for every five",
    )
    parser.add_argument(
        "--roboplan", type=Path, help="Python interpreter with roboplan, which then also solves the same problems"
    )
    parser.add_argument("--seed", type=positive, default=1, help="random seed for the poses")
    arguments = parser.parse_args()
    if bool(arguments.poses) == bool(arguments.data):
        parser.error("specify either the problem folder or --poses")
    warm_up()
    with in_words():
        if arguments.poses:
            for arm in ARMS:
                results = run_poses(arm, arguments.poses, max(1, arguments.poses * 2 // 5), arguments.seed)
                print("\n".join(results.lines()), flush=True)
        else:
            _run_problems(arguments)


def _run_problems(arguments: argparse.Namespace) -> None:
    urdf = plain((arguments.data / "ur5_spherized.urdf").read_text())
    allowed = frozenset(read_pairs(arguments.data / "ur5.srdf"))
    problems = list(read_problems(arguments.data / "problems.tar.bz2", allowed, arguments.problems))
    results, arm = Results(), ArmModel.from_string(urdf, dict.fromkeys(JOINTS, LIMIT))
    settings = (arguments.limit, arguments.searches)
    columns, peer = {"servoloop": results}, None
    if arguments.roboplan:
        models = (urdf, (arguments.data / "ur5.srdf").read_text())
        peer = Peer(arguments.roboplan, arm, models, allowed, arguments.limit)
        columns["roboplan"] = peer.results
    for problem in problems:
        if run(problem, arm, urdf, results, settings) and peer is not None:
            peer.run(problem)
    if peer is not None:
        peer.close()
    print(f"{len(problems)} problems, of which {results.valid} are valid")
    Console().print(table_of(columns))


if __name__ == "__main__":
    main()

"""Plan problems with roboplan, in a separate environment with roboplan and numpy.

The program reads JSON documents, one per line, and writes the answers. ``peer.py`` describes the documents and the
answers.
"""

import itertools
import json
import sys
import time
from typing import Any

import numpy as np
from roboplan import core, rrt  # type: ignore[import-not-found] # another environment has it

GROUP = "manipulator"
STEP_RAD = 0.05
"""Step of the collision checks, which is roboplan's default."""
COLOR = np.array([0.5, 0.5, 0.5, 1.0])


def main() -> None:
    """Plan one problem for each line of the input."""
    task = json.loads(sys.stdin.readline())
    for line in sys.stdin:
        print(json.dumps(plan(task, json.loads(line))), flush=True)


def plan(task: Any, problem: Any) -> Any:
    """Return the path, the search time and the time including shortcuts, both in s; None if there is no path."""
    scene = scene_of(task, problem)
    positions = np.zeros(len(scene.getJointNames()))
    scene.setJointPositions(positions)
    start, goal = (core.JointConfiguration(task["joints"], np.array(problem[end])) for end in ("start", "goal"))
    options = rrt.RRTOptions(
        group_name=GROUP,
        max_nodes=100_000,
        max_connection_distance=1.0,
        collision_check_step_size=STEP_RAD,
        max_planning_time=task["limit_s"],
        rrt_connect=True,
    )
    planner = rrt.RRT(scene, options)
    planner.setRngSeed(1)
    begun_s = time.perf_counter()
    try:
        path = planner.plan(start, goal)
        planned_s = time.perf_counter()
        shortcuts = core.PathShortcuttingOptions(group_name=GROUP, max_step_size=STEP_RAD, seed=1)
        path = core.PathShortcutter(scene, shortcuts).shortcut(path)
    except RuntimeError:
        return None
    total_s = time.perf_counter() - begun_s
    return {"path": [list(one) for one in path.positions], "plan_s": planned_s - begun_s, "total_s": total_s}


def scene_of(task: Any, problem: Any) -> Any:
    """Return the arm, surrounded by the objects of a problem."""
    scene = core.Scene("problem", core.loadUrdfSceneDescriptionFromXml(task["urdf"]))
    scene.importSrdf(task["srdf"])
    for number, (kind, sizes, matrix) in enumerate(problem["shapes"]):
        add = getattr(scene, f"add{kind}Geometry")
        add(f"object {number}", "universe", getattr(core, kind)(*sizes), np.asfortranarray(matrix), COLOR)
    fixed = [f"object {number}" for number in range(len(problem["shapes"]))] + task["fixed"]
    still = itertools.combinations(fixed, 2)
    scene.setCollisions([*(tuple(pair) for pair in task["allowed"]), *still], False)
    return scene


if __name__ == "__main__":
    main()

"""Reading of the public planning problems."""

import io
import tarfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.planning.problems import JOINTS, read_problems

REQUEST = f"""
start_state: {{joint_state: {{name: [{", ".join(JOINTS)}], position: [0, 0, 0, 0, 0, 0]}}}}
goal_constraints:
  - joint_constraints: [{", ".join(f"{{joint_name: {joint}, position: 0.5}}" for joint in JOINTS)}]
"""
SCENE = """
world:
  collision_objects:
    - id: can
      {pose}
      primitives: [{{type: cylinder, dimensions: [0.1, 0.03]}}]
      primitive_poses: [{{position: [1, 0, 0], orientation: [0, 0, 0, 1]}}]
"""
TURNED = "pose: {position: [0, 0, 2], orientation: [0, 0, 0.7071068, 0.7071068]}"


@pytest.mark.parametrize(("pose", "expected"), [("", (1.0, 0.0, 0.0)), (TURNED, (0.0, 1.0, 2.0))])
def test_the_pose_of_an_object_applies_to_its_shapes(tmp_path: Path, pose: str, expected: tuple[float, ...]) -> None:
    """moveit_msgs/CollisionObject has a pose, and its shapes have poses relative to it."""
    archive = tmp_path / "problems.tar.bz2"
    with tarfile.open(archive, "w:bz2") as files:
        for name, text in (("request0001.yaml", REQUEST), ("scene0001.yaml", SCENE.format(pose=pose))):
            entry = tarfile.TarInfo(f"problems/a_set/{name}")
            entry.size = len(text.encode())
            files.addfile(entry, io.BytesIO(text.encode()))
    (problem,) = read_problems(archive, frozenset(), 1)
    can = problem.scene.objects["can"]
    assert (can.pose @ can.shapes[0][1]).position_m == pytest.approx(np.array(expected), abs=1e-6)

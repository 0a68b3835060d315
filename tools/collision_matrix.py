"""Which links of the arm MoveIt need not check against each other: the <disable_collisions> of robot_arm.srdf.

python tools/collision_matrix.py                              # print them
python tools/collision_matrix.py --samples 1000000 --seed 7   # more, or other, poses

MoveIt's set-up assistant samples poses in the same way. Here the geometry is that of urdf/scene.xml, which the tests
keep equal to the URDF's.
"""

import argparse
import itertools
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

SCENE = Path(__file__).resolve().parent.parent / "urdf" / "scene.xml"
SAMPLES = 100_000
SEED = 1
ALWAYS = 0.95
"""A pair that touches in a larger share of the poses does so by design, as in MoveIt's set-up assistant."""
MEET = ("hand_left_link", "hand_right_link")
"""The fingers are there to meet: closed, they touch."""

Pair = tuple[str, str]


def pair(one: str, other: str) -> Pair:
    """The same for both orders."""
    return (one, other) if one < other else (other, one)


class Arm:
    """The arm alone, every link against every other."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec.from_file(str(SCENE))
        base = spec.body("base_link")
        links = [base, *base.find_all(mujoco.mjtObj.mjOBJ_BODY)]
        self.links = sorted(str(link.name) for link in links)
        self.adjacent = {pair(str(link.parent.name), str(link.name)) for link in links[1:]}
        for geom in spec.geoms:
            in_arm = geom.parent.name in self.links
            geom.contype = geom.conaffinity = int(in_arm)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        names = [f"joint{i}" for i in range(1, 7)] + ["hand_right_joint", "hand_left_joint"]
        self._places = [int(self.model.joint(name).qposadr[0]) for name in names]
        self._ranges = np.array([self.model.joint(name).range for name in names])

    def random_pose(self, random: np.random.Generator) -> np.ndarray:
        """Joint positions within the limits, the left finger where the right one is."""
        low, high = self._ranges.T
        pose: np.ndarray = random.uniform(low, high)
        pose[-1] = pose[-2]
        return pose

    def touching(self, pose: np.ndarray) -> set[Pair]:
        """Pairs of links that overlap in this pose, adjacent ones left out."""
        self.data.qpos[self._places] = pose
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        pairs = set()
        for one, other in self.data.contact.geom:
            bodies = (self.model.body(self.model.geom_bodyid[geom]).name for geom in (one, other))
            pairs.add(pair(*bodies))
        return pairs - self.adjacent


def count(arm: Arm, samples: int, seed: int) -> Counter[Pair]:
    """In how many random poses each pair touches."""
    random = np.random.default_rng(seed)
    return Counter(itertools.chain.from_iterable(arm.touching(arm.random_pose(random)) for _ in range(samples)))


def reasons(samples: int = SAMPLES, seed: int = SEED) -> dict[Pair, str]:
    """The pairs that need no check, each with MoveIt's word for why."""
    arm = Arm()
    touched = count(arm, samples, seed)
    upright = arm.touching(np.zeros(8))

    def reason(links: Pair) -> str | None:
        if links in arm.adjacent:
            return "Adjacent"
        if links == MEET:
            return "User"
        if links in upright:
            return "Default"
        if touched[links] > ALWAYS * samples:
            return "Always"
        return None if touched[links] else "Never"

    found = {links: reason(links) for links in itertools.combinations(arm.links, 2)}
    return {links: why for links, why in found.items() if why is not None}


def lines(found: dict[Pair, str]) -> Iterator[str]:
    """As they stand in the SRDF."""
    for (one, other), why in found.items():
        yield f'  <disable_collisions link1="{one}" link2="{other}" reason="{why}"/>'


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Print the SRDF's self-collision matrix.")
    parser.add_argument("--samples", type=int, default=SAMPLES)
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    print("\n".join(lines(reasons(arguments.samples, arguments.seed))))

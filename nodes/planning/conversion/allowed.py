"""The allowed collision matrix: pairs of links and objects that may touch, as messages and as pairs of names."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

from moveit_msgs.msg import AllowedCollisionEntry, AllowedCollisionMatrix

from nodes.planning.request_errors import RequestError
from planning.arm_model import Pair, pair


@dataclass(frozen=True, slots=True)
class AllowedCollisions:
    """Whether links and objects may touch. ``pairs`` holds individual pairs, and ``defaults`` applies to one name and
    all others."""

    pairs: Mapping[Pair, bool] = field(default_factory=dict)
    defaults: Mapping[str, bool] = field(default_factory=dict)

    @classmethod
    def from_message(cls, message: AllowedCollisionMatrix) -> "AllowedCollisions":
        """Read a message. Raises RequestError if the matrix in the message is not square."""
        names, rows = message.entry_names, message.entry_values
        defaults, values = message.default_entry_names, message.default_entry_values
        if len(names) != len(rows) or any(len(row.enabled) != len(names) for row in rows):
            raise RequestError(
                "INVALID_OBJECT_NAME",
                f"the allowed collision matrix has {len(names)} names: send the same number of rows and columns",
            )
        if len(defaults) != len(values):
            raise RequestError(
                "INVALID_OBJECT_NAME",
                f"the allowed collision matrix has {len(defaults)} default names but {len(values)} default values",
            )
        pairs = {
            pair(names[i], names[j]): bool(rows[i].enabled[j] or rows[j].enabled[i])
            for i, j in combinations(range(len(names)), 2)
        }
        return cls(pairs, dict(zip(defaults, map(bool, values), strict=True)))

    def message(self, names: Iterable[str]) -> AllowedCollisionMatrix:
        """Return the message. The matrix contains these names and the names in the pairs."""
        known = sorted({*names, *(name for one in self.pairs for name in one)})
        rows = [
            AllowedCollisionEntry(enabled=[self.pairs.get(pair(one, other), False) for other in known]) for one in known
        ]
        return AllowedCollisionMatrix(
            entry_names=known,
            entry_values=rows,
            default_entry_names=list(self.defaults),
            default_entry_values=list(self.defaults.values()),
        )

    def touching(self, names: Iterable[str]) -> frozenset[Pair]:
        """Return all pairs of these names that may touch each other."""
        known = set(names)
        loose = [name for name, may_touch in self.defaults.items() if may_touch and name in known]
        strict = {name for name, may_touch in self.defaults.items() if not may_touch}
        by_default = {pair(one, other) for one in loose for other in known - strict - {one}}
        own = {one for one, may_touch in self.pairs.items() if may_touch and known.issuperset(one)}
        return frozenset(own | (by_default - self.pairs.keys()))

"""The invariants that watch a virtual arm in a test, and those that the test must really meet."""

from collections.abc import Iterator, Mapping
from inspect import cleandoc

from servoloop.campaign.invariants import Invariant
from servoloop.campaign.invariants.watch import ALL, Watch
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.testing.errors import ArmTestError

IDLE = "this invariant examined nothing: let the test bring its condition about, or remove the name from `examined`. {}"
OWN = "An invariant of your own counts in `self.examined`."


class ChosenInvariants:
    """All invariants of campaigns but those in ``without``, and those in ``also``."""

    def __init__(self, also: tuple[type[Invariant], ...], without: tuple[str, ...], examined: tuple[str, ...]) -> None:
        """Raises ArmTestError if an invariant is unknown, or both left out and to be examined."""
        _require_known(without, ALL)
        _require_known(examined, (*ALL, *also))
        if both := [name for name in examined if name in without]:
            raise ArmTestError(f"{both[0]!r} is in both `without` and `examined`: take it out of one of them")
        self._kinds = (*(kind for kind in ALL if kind.name not in without), *also)
        self._examined = examined

    def watch(self, stack: FaultyStack) -> Watch:
        """Let the invariants watch a stack that is not up yet."""
        return Watch(stack, self._kinds)

    def idle(self, counts: Mapping[str, int]) -> Iterator[str]:
        """Yield a sentence for each invariant that should have examined something. ``counts``: by name."""
        for kind in self._kinds:
            if kind.name in self._examined and not counts[kind.name]:
                yield f"{kind.name}: {IDLE.format(f'The invariant: {_summary(kind)}' if kind in ALL else OWN)}"


def _require_known(names: tuple[str, ...], kinds: tuple[type[Invariant], ...]) -> None:
    known = [kind.name for kind in kinds]
    if unknown := [name for name in names if name not in known]:
        raise ArmTestError(f"there is no invariant {unknown[0]!r}: known are {', '.join(known)}")


def _summary(kind: type[Invariant]) -> str:
    """The first paragraph of the invariant's docstring."""
    return " ".join(cleandoc(kind.__doc__ or "").split("\n\n")[0].split())

"""Choose the invariants that are checked on a virtual arm in a test."""

from collections.abc import Iterator, Mapping, Sequence
from inspect import cleandoc

from servoloop.campaign.invariants import Invariant
from servoloop.campaign.invariants.watch import ALL, Watch
from servoloop.campaign.run import NO_CRASH
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.testing.arm_test_error import ArmTestError

IDLE = (
    "the condition of this invariant never occurred. Make the condition occur, or remove the name from `examined`. {}"
)
OWN = "Your own invariants must count their examinations in `self.examined`."


class ChosenInvariants:
    """All campaign invariants except those in ``without``, plus the additional invariants in ``also``."""

    def __init__(self, also: tuple[type[Invariant], ...], without: tuple[str, ...], examined: tuple[str, ...]) -> None:
        """Choose the invariants.

        Raises ArmTestError if an invariant is unknown, if it is in both ``without`` and ``examined``, or if
        ``examined`` contains ``no crash``.
        """
        if NO_CRASH in examined:
            raise ArmTestError(f"{NO_CRASH!r} has no condition that a test could meet: remove it from `examined`")
        _require_known([name for name in without if name != NO_CRASH], ALL)
        _require_known(examined, (*ALL, *also))
        if both := [name for name in examined if name in without]:
            raise ArmTestError(f"{both[0]!r} is in both `without` and `examined`: remove the name from one list")
        self._kinds = (*(kind for kind in ALL if kind.name not in without), *also)
        self._examined = examined
        self._finds_crashes = NO_CRASH not in without

    def watch(self, stack: FaultyStack) -> Watch:
        """Return a monitor that checks the invariants on a stack. The stack must not be active yet."""
        return Watch(stack, self._kinds)

    def crash(self, stack: FaultyStack) -> Iterator[str]:
        """Yield a message if a controller of the stack has failed although no fault was injected into it."""
        if self._finds_crashes:
            try:
                stack.require_no_defect()
            except RuntimeError as error:
                cause = error.__cause__
                yield f"{NO_CRASH}: {error}: {type(cause).__name__}: {cause}"

    def idle(self, counts: Mapping[str, int]) -> Iterator[str]:
        """Yield a message for each invariant in ``examined`` whose condition never occurred.

        ``counts`` contains the number of times each invariant has examined its condition, keyed by invariant name.
        """
        for kind in self._kinds:
            if kind.name in self._examined and not counts[kind.name]:
                yield f"{kind.name}: {IDLE.format(f'The invariant: {_summary(kind)}' if kind in ALL else OWN)}"


def _require_known(names: Sequence[str], kinds: tuple[type[Invariant], ...]) -> None:
    known = [kind.name for kind in kinds]
    if unknown := [name for name in names if name not in known]:
        raise ArmTestError(f"there is no invariant {unknown[0]!r}: choose from {', '.join(known)}")


def _summary(kind: type[Invariant]) -> str:
    """Return the first paragraph of an invariant's docstring."""
    return " ".join(cleandoc(kind.__doc__ or "").split("\n\n")[0].split())

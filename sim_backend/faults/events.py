"""All fault types. The type ``FaultEvent`` is the union of all fault classes; the field ``kind`` distinguishes them."""

from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

from sim_backend.faults.event import Event
from sim_backend.faults.false_replies import FalsePosition, FalseValue
from sim_backend.faults.lines import AdapterUnplugged, CableCut, Echo, ForeignPackets, WeakSupply
from sim_backend.faults.mechanics import Jammed, Overload, SlippedHorn
from sim_backend.faults.replies import (
    Collision,
    FlippedReplies,
    LateReplies,
    LostReplies,
    MissedInstructions,
    Noise,
    TruncatedReplies,
)
from sim_backend.faults.servos import (
    BrownOut,
    DeadEncoder,
    HardwareError,
    Hot,
    LoosePlug,
    Overcurrent,
    Silent,
    StuckEncoder,
)
from sim_backend.faults.settings import EepromGone, WrongId, WrongMode, WrongRate, WrongSetting
from sim_backend.faults.stack import (
    ClientCancels,
    ClientDies,
    ClientNonsense,
    ControllerJumps,
    ControllerNan,
    ControllerRaises,
    LoopStall,
)

FaultEvent = Annotated[
    Silent | BrownOut | LoosePlug | CableCut | WeakSupply
    | LostReplies | LateReplies | TruncatedReplies | FlippedReplies | Noise | Echo | Collision | MissedInstructions
    | Jammed | Overload | SlippedHorn | StuckEncoder | DeadEncoder | HardwareError
    | FalsePosition | FalseValue | Hot | Overcurrent
    | WrongId | WrongRate | WrongMode | WrongSetting | EepromGone
    | AdapterUnplugged | ForeignPackets
    | LoopStall | ControllerRaises | ControllerNan | ControllerJumps | ClientNonsense | ClientCancels | ClientDies,
    Field(discriminator="kind"),
]  # fmt: skip

EVENT: Final[TypeAdapter[Any]] = TypeAdapter(FaultEvent)
"""Converter from plain data to an event."""
KINDS: Final[dict[str, type[Event]]] = {
    kind.model_fields["kind"].default: kind
    for kind in FaultEvent.__origin__.__args__  # type: ignore[attr-defined]
}
"""Class of each fault type, keyed by name."""

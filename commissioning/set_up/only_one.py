"""The one servo on the line: whether there is just one, and whether it may become what a place wants."""

from collections.abc import Sequence
from functools import partial
from typing import Final

from commissioning.provision import drives, persistent_registers
from commissioning.set_up.place import FACTORY_ID, Place, SetUpError
from commissioning.who import Answer, who_answers, who_answers_elsewhere
from drivers.bus.bus import Bus
from drivers.bus.confirm import confirmed_states
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.servos.catalog import known_as
from drivers.servos.voltage import voltage_fault

LIMIT_UNIT_V: Final = 0.1
LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))
"""What tables call the voltages that a servo allows."""


class NotYet(SetUpError):
    """What the user can mend by connecting something else: it is asked for again."""


def only_servo(bus: Bus, rates: Sequence[int]) -> Answer:
    """The one servo that answers, at the line's rate or one of these. Raises NotYet where there is none, or several."""
    found = who_answers(bus) or who_answers_elsewhere(bus, [rate for rate in rates if rate != bus.baud])
    if not found:
        raise NotYet(
            f"no servo answers on {bus.name} at any baud rate: is its supply on, is its cable plugged in at both ends, "
            "is the adapter set to USB?"
        )
    ids = ", ".join(str(answer.servo_id) for answer in found)
    if len(found) > 1:
        raise NotYet(f"several servos answer (IDs {ids}): connect only one")
    if not found[0].clear:
        raise NotYet(f"servo {ids} never answers in one piece: several servos have ID {ids}, or the cable is bad: "
                     "connect only one")  # fmt: skip
    return found[0]


def require_fit(bus: Bus, servo_id: int, place: Place, places: Sequence[Place]) -> float:
    """The voltage (V) at a servo that may become the place's; ``bus`` is at its rate.

    Raises NotYet where it is another's, of another model or under torque; SetUpError for a wrong voltage.
    """
    owner = next((one.joint for one in places if one.servo_id == servo_id), None)
    if servo_id not in (FACTORY_ID, place.servo_id) and owner is not None:
        raise NotYet(f"this servo has ID {servo_id}, which is that of {owner}: it belongs there already")
    _require_model(bus, servo_id, place)
    voltage_v = voltage(bus, servo_id)
    _require_voltage(bus, servo_id, place, voltage_v)
    if drives(bus, servo_id, place.model):
        raise NotYet(
            f"servo {servo_id} holds torque, and nothing is written under torque: switch its supply off and on. What "
            "it holds falls then"
        )
    return voltage_v


def voltage(bus: Bus, servo_id: int) -> float:
    """What the servo measures at its supply, V."""
    return state_of(bus, servo_id).voltage_v


def state_of(bus: Bus, servo_id: int) -> ServoState:
    """The servo's state, whose position two readings in a row agree on. Raises NotYet."""
    state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if isinstance(state, ServoState):
        return state
    raise NotYet(f"{state.text}: is its plug loose?")


def _require_model(bus: Bus, servo_id: int, place: Place) -> None:
    number = retry(partial(bus.read, servo_id, place.series.model_number))
    if number != place.model.number:
        raise NotYet(
            f"servo {servo_id} is model {number} ({known_as(number, place.series)}), and {place.joint} has a "
            f"{place.model.name} ({place.model.number}) in the robot file"
        )


def _require_voltage(bus: Bus, servo_id: int, place: Place, voltage_v: float) -> None:
    rated_v, model = place.model.rated_voltage_v, place.model.name
    fault = voltage_fault(place.model, voltage_v)
    if fault is not None and fault.outside:
        fault_text = "too much" if fault.kind == "over-voltage" else "too little"
        raise SetUpError(
            f"{voltage_v:.1f} V is {fault_text} for a servo of {rated_v:.1f} V ({model}): switch the supply off, and "
            "connect the right one, or name the right model in the robot file"
        )
    lowest_v, highest_v = _limits(bus, servo_id, place)
    if not lowest_v <= voltage_v <= highest_v:
        raise SetUpError(
            f"servo {servo_id} measures {voltage_v:.1f} V, and allows {lowest_v:.1f} to {highest_v:.1f} V by its own "
            f"limits: is it a {model} of {rated_v:.1f} V, and the supply the right one?"
        )


def _limits(bus: Bus, servo_id: int, place: Place) -> tuple[float, float]:
    """The lowest and the highest voltage that the servo allows, V, or will allow by the robot file."""
    table, said = persistent_registers(place.model), dict(place.settings)
    names = next(names for names in LIMITS if names[0] in table)
    lowest, highest = (
        said[name] if name in said else retry(partial(bus.read, servo_id, table[name])) for name in names
    )
    return lowest * LIMIT_UNIT_V, highest * LIMIT_UNIT_V

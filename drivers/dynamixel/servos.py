"""What is known of the servos on one line: what they are, and how the state of each is to be asked for."""

from collections.abc import Mapping

from drivers.dynamixel.models import X, series_of
from drivers.dynamixel.series import Series, StateBlock
from drivers.dynamixel.x_series import CURRENT_UNIT_A
from drivers.registers import ServoModel


class Servos:
    """By ID. Who is not known is taken to be of the X series until it is identified."""

    def __init__(self, models: Mapping[int, ServoModel]) -> None:
        self._models = dict(models)
        self._series = {i: series_of(model) for i, model in models.items()}
        self._mapped: dict[int, tuple[StateBlock, ...]] = {}
        self.changes = 0
        """Grows whenever the answer to ``blocks`` changes, for whoever keeps what it made of it."""

    def series(self, servo_id: int) -> Series:
        """What the servo is."""
        return self._series.get(servo_id, X)

    def current_unit_a(self, servo_id: int) -> float | None:
        """What one unit of its present current is; None for one that measures none, or is not known yet."""
        model = self._models.get(servo_id)
        return CURRENT_UNIT_A.get(model.name) if model else None

    def blocks(self, servo_id: int) -> tuple[StateBlock, ...]:
        """What the servo may be asked for, the first if nothing speaks against it."""
        return self._mapped.get(servo_id) or self.series(servo_id).blocks

    def take_for(self, servo_id: int, model: ServoModel) -> None:
        """What the servo is has been seen."""
        if self._models.get(servo_id) != model:
            self.changes += 1
        self._models[servo_id] = model
        self._series[servo_id] = series_of(model)

    def is_mapped(self, servo_id: int) -> bool:
        """Whether the state is asked for through indirect registers."""
        return servo_id in self._mapped

    def map(self, servo_id: int, block: StateBlock) -> None:
        """The servo's indirect registers show this block. A direct one is asked for only while it owes an answer."""
        self._mapped[servo_id] = (block, *self.series(servo_id).blocks[1:])
        self.changes += 1

    def unmap(self, servo_id: int) -> None:
        """They do not, or may not: the direct blocks."""
        if self._mapped.pop(servo_id, None):
            self.changes += 1

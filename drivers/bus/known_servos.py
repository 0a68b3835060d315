"""The servos of one bus with their models, and the packets that read their states and write their goals."""

from collections.abc import Callable, Mapping, Sequence
from struct import Struct

from drivers.bus.fast_read import fast_plan
from drivers.bus.read_plan import ReadPlan, state_plan
from drivers.protocol import v1
from drivers.servos.catalog import series_of, wire_protocol
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS, STS_PROTOCOL
from drivers.servos.firmware import reads_fast
from drivers.servos.register import ServoModel
from drivers.servos.series import Series, StateBlock
from drivers.types import ServoGoal

GoalWrite = Callable[[Mapping[int, ServoGoal]], bytes]
"""Function that encodes servo goals as a sync write."""


class KnownServos:
    """Servos of one bus. An unknown servo is assumed to be of the same series as the first known servo."""

    def __init__(self, models: Mapping[int, ServoModel]) -> None:
        """Raise ValueError if the servos cannot share a bus."""
        self.protocol = wire_protocol(models)
        self.models = dict(models)
        """Models of the known servos, keyed by ID."""
        self._usual = next(iter(map(series_of, models.values())), STS if self.protocol is STS_PROTOCOL else X)
        self.mapped: dict[int, tuple[StateBlock, ...]] = {}
        """State blocks of the servos whose states are read through indirect registers, keyed by ID."""
        self.firmware: dict[int, int] = {}
        """Firmware versions of the Dynamixel X servos that were identified, keyed by ID."""
        self.separate: set[int] = set()
        """Servos that do not support group reads, so that each of them is read separately."""
        self.written_alone: set[int] = set()
        """Servos that do not support group writes, so that each of them is written separately. This set includes the
        servos in ``separate``.
        """
        self._plans: dict[tuple[tuple[int, ...], int], ReadPlan] = {}
        self._fast: dict[tuple[int, ...], ReadPlan | None] = {}
        self._writes: dict[tuple[int, ...], list[GoalWrite]] = {}

    def series(self, servo_id: int) -> Series:
        model = self.models.get(servo_id)
        return series_of(model) if model else self._usual

    def model(self, servo_id: int) -> ServoModel:
        """Return the model of a servo, or any model of its series if the servo is unknown."""
        return self.models.get(servo_id) or self._usual.models[0]

    @property
    def read_together(self) -> bool:
        if self.protocol.group_read == "bulk":
            models = self.models.values()
            return bool(models) and all(series_of(model).bulk_read(model) for model in models)
        return self.in_sync

    @property
    def in_sync(self) -> bool:
        """Whether one sync read can request the states of any selection of servos on this bus."""
        return self.protocol.group_read == "sync" and not self.separate

    def together(self, servo_ids: tuple[int, ...]) -> tuple[int, ...]:
        """Return the servos in ``servo_ids`` whose states one packet can request."""
        if self.protocol.group_read == "sync":
            return tuple(i for i in servo_ids if i not in self.separate)
        return servo_ids if self.read_together else ()

    def set_separate(self, servo_id: int, separate: bool) -> None:
        """Choose whether a servo is read and written separately or in groups."""
        for servos in (self.separate, self.written_alone):
            (servos.add if separate else servos.discard)(servo_id)
        self._forget_plans()

    def set_written_alone(self, servo_id: int, alone: bool) -> None:
        """Choose whether the goals of a servo are written separately or in groups."""
        (self.written_alone.add if alone else self.written_alone.discard)(servo_id)

    def identified(self, servo_id: int, model: ServoModel) -> None:
        if self.models.get(servo_id) != model:
            self.models[servo_id] = model
            self._forget_plans()

    def blocks(self, servo_id: int) -> tuple[StateBlock, ...]:
        """Return the state blocks that can be read from a servo, with the preferred block first."""
        return self.mapped.get(servo_id) or self.series(servo_id).blocks

    def map(self, servo_id: int, block: StateBlock) -> None:
        """Prefer this block of indirect registers. Direct blocks are read only while late replies are possible."""
        self.mapped[servo_id] = (block, *self.series(servo_id).blocks[1:])
        self._forget_plans()

    def unmap(self, servo_id: int) -> None:
        """Use the direct blocks, because the map of the servo's indirect registers is lost or unknown."""
        if self.mapped.pop(servo_id, None):
            self._forget_plans()

    def plan(self, servo_ids: tuple[int, ...], place: int = 0) -> ReadPlan:
        """Return the read plan for block number ``place`` of each servo."""
        plan = self._plans.get((servo_ids, place))
        if plan is None:
            blocks = {i: self.blocks(i)[place] for i in servo_ids}
            plan = self._plans[servo_ids, place] = state_plan(
                self.protocol, blocks, self._scales(servo_ids), separate=not self.separate.isdisjoint(servo_ids)
            )
        return plan

    def fast_plan(self, servo_ids: tuple[int, ...]) -> ReadPlan | None:
        """Return the plan of a fast sync read, or None if the servos have different blocks or do not support it."""
        if servo_ids not in self._fast:
            block, *others = {self.blocks(i)[0] for i in servo_ids}
            alike = block.fast and not others and all(map(self._may_read_fast, servo_ids))
            self._fast[servo_ids] = fast_plan(block, self._scales(servo_ids)) if alike else None
        return self._fast[servo_ids]

    def _may_read_fast(self, servo_id: int) -> bool:
        """Return whether a fast sync read of this servo may work, based on its firmware version if known."""
        known = reads_fast(self.model(servo_id), self.firmware.get(servo_id))
        return known is not False and servo_id not in self.separate

    def set_firmware(self, servo_id: int, version: int) -> None:
        """Record the firmware version that a servo reports."""
        if self.firmware.get(servo_id) != version:
            self.firmware[servo_id] = version
            self._forget_plans()

    def _scales(self, servo_ids: tuple[int, ...]) -> dict[int, float | None]:
        """Return the scale of each servo. The unit in which a Dynamixel X reports its current is unknown until the
        servo is identified."""
        v1_line = self.protocol.packets is v1
        return {i: self.series(i).scale_of(self.model(i)) if v1_line or i in self.models else None for i in servo_ids}

    def _forget_plans(self) -> None:
        for kept in (self._plans, self._fast, self._writes):
            kept.clear()

    def goals(self, goals: Mapping[int, ServoGoal]) -> bytes:
        """Encode one sync write of goals for each series. Servos that need separate writes are omitted.

        Raises ValueError if a goal does not fit.
        """
        servo_ids = tuple(goals)
        if self.written_alone:
            servo_ids = tuple(i for i in servo_ids if i not in self.written_alone)
        writes = self._writes.get(servo_ids)
        if writes is None:
            writes = self._writes[servo_ids] = [self._goal_write(*run) for run in self._by_series(servo_ids)]
        return b"".join([write(goals) for write in writes])

    def _goal_write(self, series: Series, servo_ids: tuple[int, ...]) -> GoalWrite:
        order = "<" if self.protocol.byte_order == "little" else ">"
        layout = Struct(order + f"B{series.goal_fields}" * len(servo_ids))
        entries = [(i, series.goal_of(self.model(i))) for i in servo_ids]
        sync_write, address, size = self.protocol.packets.sync_write, series.goal_address, series.goal_size

        def write(goals: Mapping[int, ServoGoal]) -> bytes:
            numbers: list[int] = []
            for servo_id, numbers_of in entries:
                numbers.append(servo_id)
                numbers += numbers_of(goals[servo_id])
            packet: bytes = sync_write(address, size, layout.pack(*numbers))
            return packet

        return write

    def goal_packet(self, servo_id: int, goal: ServoGoal) -> bytes:
        """Encode a write of one servo's goal. Raises ValueError if the goal does not fit."""
        series, packets = self.series(servo_id), self.protocol.packets
        order = "<" if self.protocol.byte_order == "little" else ">"
        data = Struct(order + series.goal_fields).pack(*series.goal_of(self.model(servo_id))(goal))
        packet: bytes = packets.packet(servo_id, packets.WRITE, packets.place(series.goal_address) + data)
        return packet

    def torque_off(self, servo_ids: Sequence[int]) -> bytes:
        """For each series, encode one sync write that disables the torque of these servos."""
        packets, order = self.protocol.packets, self.protocol.byte_order
        return b"".join(
            packets.sync_write(off.address, off.size, b"".join(bytes((i,)) + off.encode(0, order) for i in ids))
            for series, ids in self._by_series(tuple(servo_ids))
            for off in (series.torque_enable,)
        )

    def _by_series(self, servo_ids: tuple[int, ...]) -> list[tuple[Series, tuple[int, ...]]]:
        series = dict.fromkeys(self.series(i) for i in servo_ids)
        return [(each, tuple(i for i in servo_ids if self.series(i) is each)) for each in series]

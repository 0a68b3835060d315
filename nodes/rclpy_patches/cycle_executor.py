"""Executor that reuses its wait set. Supports rclpy 7.1.5.

At each wake-up, rclpy's executor collects the entities of all nodes and builds a new wait set. This happens twice for
each message. With the roughly one hundred entities of a stack, this takes 1 to 1.5 ms each time. This executor builds a
new wait set only if the entities have changed. The executor relies on private parts of rclpy's executor: its tasks,
guard conditions and take functions.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Final

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Task
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities

from nodes.rclpy_patches.patch import RCLPY_7_1_5, Patch, missing

Entity = Any
Take = Callable[[Entity], object]


class CycleExecutor(SingleThreadedExecutor):
    """Executor that returns from ``serve`` when it is woken. Callbacks run in the same way as with rclpy's executor."""

    def __init__(self, turn: AbstractContextManager[object]) -> None:
        """Create the executor. The executor holds ``turn`` while callbacks run, but not while it waits."""
        super().__init__()
        self._turn = turn
        self._posted = GuardCondition(callback=None, callback_group=None, context=self._context)
        self._outdated = True
        self._blocked = False
        self._tasks: list[tuple[Task, Entity, Node | None]]
        self._handles = ExitStack()
        self._wait_set: Any = None
        self._add: list[tuple[Callable[[Any, Any], None], Any]] = []
        self._waitables: list[tuple[Entity, Node]] = []
        self._entities: dict[str, dict[int, tuple[Entity, Node, Take]]] = {}

    def post(self) -> None:
        """Make ``serve`` return because a client is waiting for a response. This method is thread-safe and does not
        block."""
        self._posted.trigger()

    def wake(self) -> None:
        """Mark the wait set as outdated. rclpy calls this method when entities are added or removed."""
        self._outdated = True
        super().wake()

    def add_node(self, node: Node) -> bool:
        self._outdated = True
        return bool(super().add_node(node))

    def remove_node(self, node: Node) -> None:
        self._outdated = True
        super().remove_node(node)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self._release()
        self._posted.destroy()
        return bool(super().shutdown(timeout_sec))

    def serve(self, timeout_s: float) -> None:
        """Serve until the executor is woken, callbacks have run, or the timeout has passed. Exceptions propagate."""
        with self._turn:
            self._resume_tasks()
        self._wait(timeout_s)
        guards = self._wait_set.get_ready_entities("guard_condition")
        for guard, _, _ in self._entities["guard_condition"].values():  # Waiting resets guards.
            guard._executor_triggered |= guard.handle.pointer in guards
        with self._turn:
            self._run_ready()

    def _wait(self, timeout_s: float) -> None:
        if self._context.ok():
            if self._outdated:
                self._gather()
            self._fill()
            self._wait_set.wait(int(timeout_s * 1e9))
        if not self._context.ok():
            raise ExternalShutdownException

    def _resume_tasks(self) -> None:
        """Resume the tasks whose callbacks are awaiting a result."""
        with self._tasks_lock:
            waiting = [task for task, _, _ in self._tasks if not task.executing() and not task.done()]
        self._run(waiting)

    def _run(self, tasks: Iterable[Task]) -> None:
        try:
            for task in tasks:
                task()
                if task.done():
                    task.result()  # Raise the task's exception, if any.
        finally:
            with self._tasks_lock:
                self._tasks = [entry for entry in self._tasks if not entry[0].done() and not entry[0].cancelled()]
                # A waiting task keeps the other entities of its group out of the wait set until the task ends.
                blocked = any(_blocks(entity) for _, entity, _ in self._tasks)
            self._outdated = self._outdated or blocked or self._blocked
            self._blocked = blocked

    def _release(self) -> None:
        self._handles.close()
        self._wait_set = None

    def _gather(self) -> None:
        """Collect all entities for a new wait set, and keep references to their handles until the next collection."""
        self._release()
        self._outdated = False
        self._add.clear()
        nodes = self.get_nodes()
        made = rclpy_implementation.WaitSet
        sizes = NumberOfEntities()
        self._entities = {
            "subscription": self._hold(nodes, "subscriptions", self._take_subscription, made.add_subscription),
            "guard_condition": self._hold(nodes, "guards", self._take_guard_condition, made.add_guard_condition),
            "timer": self._hold(nodes, "timers", self._take_timer, made.add_timer),
            "client": self._hold(nodes, "clients", self._take_client, made.add_client),
            "service": self._hold(nodes, "services", self._take_service, made.add_service),
        }
        for guard in (self._posted, self._guard, self._sigint_gc):
            self._handles.enter_context(guard.handle)
            self._add.append((made.add_guard_condition, guard.handle))
        self._waitables = []
        for waitable, node in self._executable(nodes, "waitables"):
            try:
                self._handles.enter_context(waitable)
            except InvalidHandle:
                continue
            sizes += waitable.get_num_entities()
            self._waitables.append((waitable, node))
        self._handles.enter_context(self._context.handle)
        own = {kind: len(found) for kind, found in self._entities.items()}
        self._wait_set = made(
            own["subscription"] + sizes.num_subscriptions,
            own["guard_condition"] + sizes.num_guard_conditions + 3,
            own["timer"] + sizes.num_timers,
            own["client"] + sizes.num_clients,
            own["service"] + sizes.num_services,
            sizes.num_events,
            self._context.handle,
        )

    def _executable(self, nodes: Iterable[Node], kind: str) -> Iterator[tuple[Entity, Node]]:
        return ((entity, node) for node in nodes for entity in getattr(node, kind) if self.can_execute(entity))

    def _hold(
        self, nodes: Iterable[Node], kind: str, take: Take, add: Callable[..., None]
    ) -> dict[int, tuple[Entity, Node, Take]]:
        """Collect the entities of one type, keyed by handle pointer, because the wait set identifies ready entities by
        these pointers."""
        found = {}
        for entity, node in self._executable(nodes, kind):
            try:
                self._handles.enter_context(entity.handle)
            except InvalidHandle:
                continue
            found[entity.handle.pointer] = entity, node, take
            self._add.append((add, entity.handle))
        return found

    def _fill(self) -> None:
        """Add all entities to the wait set again, because waiting removes them."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._add:
            add(wait_set, handle)
        for waitable, _ in self._waitables:
            waitable.add_to_wait_set(wait_set)
        for guard, _, _ in self._entities["guard_condition"].values():
            if guard._executor_triggered:  # The guard condition was triggered while its callback could not run.
                guard.trigger()

    def _run_ready(self) -> None:
        ready = [(w, node, self._take_waitable) for w, node in self._waitables if w.is_ready(self._wait_set)]
        for kind, entities in self._entities.items():
            if kind == "guard_condition":
                ready += [guard for guard in entities.values() if guard[0]._executor_triggered]
            else:
                ready += [
                    entities[pointer] for pointer in self._wait_set.get_ready_entities(kind) if pointer in entities
                ]
        self._run(self._make_handler(*entry) for entry in ready if self._can_run(entry[0]))

    def _can_run(self, entity: Entity) -> bool:
        # rcl reports a timer as ready even if the timer has been canceled in the meantime.
        return self.can_execute(entity) and (not isinstance(entity, Timer) or entity.is_ready())


def _blocks(entity: Entity) -> bool:
    """Return whether a running callback of the entity blocks its callback group. A task without an entity does not
    block any group."""
    return entity is not None and not isinstance(entity.callback_group, ReentrantCallbackGroup)


_ATTRIBUTES: Final = ("_context", "_guard", "_sigint_gc", "_tasks", "_tasks_lock")
_TAKES: Final = ("subscription", "guard_condition", "timer", "client", "service", "waitable")
_HANDLER: Final = ("self", "entity", "node", "take_from_wait_list")
_WAIT_SET: Final = ("clear_entities", "wait", "get_ready_entities", *(f"add_{name}" for name in _TAKES[:-1]))
_SIZES: Final = 6
"""Number of size arguments that the constructor of a wait set takes before the context."""


def _differences() -> Iterable[str]:
    made = SingleThreadedExecutor.__mro__[1].__init__.__code__.co_names
    yield from (f"Executor has no {name}" for name in _ATTRIBUTES if name not in made)
    yield from missing(SingleThreadedExecutor, [f"_take_{name}" for name in _TAKES])
    yield from missing(rclpy_implementation.WaitSet, _WAIT_SET)
    handler = SingleThreadedExecutor._make_handler
    if tuple(inspect.signature(handler).parameters) != _HANDLER or "_tasks" not in handler.__code__.co_names:
        yield "Executor._make_handler creates tasks differently"
    if "_executor_triggered" not in GuardCondition.__init__.__code__.co_names:
        yield "GuardCondition has no _executor_triggered"
    if f"arg{_SIZES}: rclpy._rclpy_pybind11.Context)" not in (rclpy_implementation.WaitSet.__init__.__doc__ or ""):
        yield "WaitSet takes different arguments"


PATCH: Final = Patch(
    "cycle_executor",
    RCLPY_7_1_5,
    "each wake-up of the ROS thread takes 1 to 1.5 ms more processor time",
    _differences,
)

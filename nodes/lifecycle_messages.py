"""Life cycle states and transitions as lifecycle_msgs has them."""

from lifecycle_msgs.msg import State, TransitionEvent
from lifecycle_msgs.msg import Transition as TransitionMessage

from controller.manager.registry import Transition
from hal.lifecycle import LifecycleState

_VERBS = {
    (LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE): ("configure", "configuring"),
    (LifecycleState.INACTIVE, LifecycleState.UNCONFIGURED): ("cleanup", "cleaningup"),
    (LifecycleState.INACTIVE, LifecycleState.ACTIVE): ("activate", "activating"),
    (LifecycleState.ACTIVE, LifecycleState.INACTIVE): ("deactivate", "deactivating"),
}
"""Each transition's label, and the label of the state on the way."""


def state_message(state: LifecycleState) -> State:
    """A life cycle state as ROS has it."""
    return State(id=state.value, label=state.name.lower())


def transition_events(transition: Transition, stamp_ns: int) -> list[TransitionEvent]:
    """The two events of a transition, as upstream publishes them: its beginning, and its success."""
    verb, on_the_way = _VERBS[transition.start, transition.goal]
    start, goal = state_message(transition.start), state_message(transition.goal)
    between = State(id=getattr(State, f"TRANSITION_STATE_{on_the_way.upper()}"), label=on_the_way)
    begun = TransitionMessage(id=getattr(TransitionMessage, f"TRANSITION_{verb.upper()}"), label=verb)
    done_id = getattr(TransitionMessage, f"TRANSITION_ON_{verb.upper()}_SUCCESS")
    done = TransitionMessage(id=done_id, label="transition_success")
    return [
        TransitionEvent(timestamp=stamp_ns, transition=begun, start_state=start, goal_state=between),
        TransitionEvent(timestamp=stamp_ns, transition=done, start_state=between, goal_state=goal),
    ]

"""Convert lifecycle states and transitions to lifecycle_msgs messages."""

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
"""Labels of each transition and of its intermediate state."""


def state_message(state: LifecycleState) -> State:
    """Convert a lifecycle state to a ROS message."""
    return State(id=state.value, label=state.name.lower())


def transition_events(transition: Transition, stamp_ns: int) -> list[TransitionEvent]:
    """Return the two events of a transition, its start and its success, as ros2_control publishes them."""
    verb, intermediate = _VERBS[transition.start, transition.goal]
    start, goal = state_message(transition.start), state_message(transition.goal)
    between = State(id=getattr(State, f"TRANSITION_STATE_{intermediate.upper()}"), label=intermediate)
    started = TransitionMessage(id=getattr(TransitionMessage, f"TRANSITION_{verb.upper()}"), label=verb)
    done_id = getattr(TransitionMessage, f"TRANSITION_ON_{verb.upper()}_SUCCESS")
    done = TransitionMessage(id=done_id, label="transition_success")
    return [
        TransitionEvent(timestamp=stamp_ns, transition=started, start_state=start, goal_state=between),
        TransitionEvent(timestamp=stamp_ns, transition=done, start_state=between, goal_state=goal),
    ]

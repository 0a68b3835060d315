"""State of a displayed robot, while one thread processes messages and another thread reads the state."""

import threading
from collections import deque
from collections.abc import Iterator

from servoloop.recording.mcap_messages import STATUSES, Received
from servoloop.recording.robot_state import Health
from tests.recorder.rig import Rig
from tests.view.rig import watched

PATIENCE_S = 0.2


class Interrupted(deque[Health]):
    """Queue that receives a message from another thread while it is read, as can happen in a garbage collection."""

    def __init__(self, rows: Iterator[Health], taker: threading.Thread) -> None:
        super().__init__(rows)
        self.taker = taker

    def __iter__(self) -> Iterator[Health]:
        rows = super().__iter__()
        yield next(rows)
        self.taker.start()
        self.taker.join(PATIENCE_S)
        yield from rows


def test_messages_may_arrive_while_the_last_minute_is_read() -> None:
    rig = Rig()
    rig.run(2.0)
    found = watched(rig)
    (*_, newest) = (one for sample in rig.samples for one in rig.messages.of_cycle(sample) if one.topic == STATUSES)
    message = Received(newest.topic, newest.stamp_ns, newest.message, 0)
    taker = threading.Thread(target=found.take, args=[message], daemon=True)
    found._health = Interrupted(iter(found.minute().health), taker)
    before = len(found.minute().health)
    taker.join()
    assert len(found._health) == before + 1

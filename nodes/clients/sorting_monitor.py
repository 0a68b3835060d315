"""Monitor jobs that camera images have started, using the topics of the sorting cell."""

import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from apple_quality_msgs.msg import AppleQualityArray
from rclpy.node import Node
from std_msgs.msg import String

from nodes.clients.camera_pictures import subscribe_pictures
from pick_place.job import JobPhase
from pick_place.settings import normal_grade

KEPT: Final = 100
"""Number of messages with a graded apple that are stored between two jobs."""
SAME_APPLE_S: Final = 0.5
"""Time after the start of a job during which its apple is still on the stand, in seconds."""
ENDS: Final = (JobPhase.DONE, JobPhase.ERROR)
"""Phases that end a job."""


@dataclass(frozen=True, slots=True)
class SeenApple:
    """The first graded apple in a message. The apple's stamp is the time of the image, in ROS time."""

    stamp_s: float
    grade: str
    diameter_mm: float
    red_ratio: float
    defect_score: float


@dataclass(slots=True)
class SortingJob:
    """One job of the pick-and-place node."""

    request_id: int
    grade: str
    started_s: float
    """ROS time of the first state of the job."""
    apple: SeenApple | None = None
    """Apple that started the job, which is the first apple with this grade after the previous job. The message with
    this apple may arrive after the first state of the job. A monitor that connected too late to receive this
    message uses the values from the next image of the same apple."""
    phase: str = ""
    message: str = ""

    @property
    def ended(self) -> bool:
        """Whether the job has succeeded or failed."""
        return self.phase in ENDS

    @property
    def success(self) -> bool:
        """Whether the job is done."""
        return self.phase == JobPhase.DONE

    @property
    def picture_to_goal_s(self) -> float | None:
        """Time from the image to the start of the job, in seconds; None if the image is unknown."""
        if self.apple is None or self.apple.stamp_s > self.started_s:
            return None
        return self.started_s - self.apple.stamp_s


@dataclass(slots=True)
class SortingMonitor:
    """Subscriber to the job states and the apples. The subscriber receives messages only while the caller spins."""

    jobs: list[SortingJob] = field(default_factory=list)
    """All jobs since the monitor started, oldest first."""
    newest: SeenApple | None = None
    """Apple in the latest message; None if that message does not contain a graded apple."""
    _node: Node | None = None
    _seen: deque[SeenApple] = field(default_factory=lambda: deque(maxlen=KEPT))

    def subscribe(self, node: Node) -> None:
        """Subscribe to the topics."""
        self._node = node
        node.create_subscription(AppleQualityArray, "sorting/perception/apple_quality", self._on_apples, 10)
        node.create_subscription(String, "sorting/arm/state", self._on_state, 10)

    def receive_pictures(self, store: Callable[[int, bytes], None]) -> None:
        """Pass the stamp (in ns of ROS time) and the encoded message of every compressed image to ``store``."""
        if self._node is not None:
            subscribe_pictures(self._node, store)

    def _on_apples(self, message: Any) -> None:
        stamp_s = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        graded = (apple for apple in message.apples if normal_grade(apple.grade))
        self.newest = next(
            (
                SeenApple(stamp_s, normal_grade(apple.grade), apple.diameter_mm, apple.red_ratio, apple.defect_score)
                for apple in graded
            ),
            None,
        )
        if self.newest is not None:
            self._seen.append(self.newest)
            if self.jobs and self.jobs[-1].apple is None:
                self.jobs[-1].apple = self._cause(self.jobs[-1])

    def _on_state(self, message: Any) -> None:
        state = json.loads(message.data)
        if not self.jobs or self.jobs[-1].request_id != state["request_id"]:
            self.jobs.append(SortingJob(int(state["request_id"]), str(state["grade"]), float(state["ts"])))
        job = self.jobs[-1]
        job.apple = job.apple or self._cause(job)
        job.phase, job.message = state["phase"], state["message"]
        if job.ended:  # An idle node starts the next job with the first apple that arrives from now on.
            self._seen.clear()

    def _cause(self, job: SortingJob) -> SeenApple | None:
        until_s = job.started_s + SAME_APPLE_S
        return next((one for one in self._seen if one.grade == job.grade and one.stamp_s <= until_s), None)

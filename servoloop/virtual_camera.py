"""Camera source that provides images from a virtual camera.

The camera renders the emulator's world in the process that reads the images.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from drivers.clock import Clock
from perception.camera_view import CameraPose, CameraView
from perception.frames import Frame
from perception.grading.settings import GradingSettings
from perception.intrinsics import Intrinsics
from perception.perception_errors import CameraLost, CameraMissing, CameraSilent
from sim_backend.camera.light import Light
from sim_backend.camera.scene_camera import SceneCamera
from sim_backend.camera.truth import AppleTruth
from sim_backend.scene.world_feed import PERIOD_S, WorldFeedClient, feed_path

RATE_HZ: Final = 10.0
POLL_S: Final = 0.005
"""Interval at which the camera checks for a new world state, in seconds."""
REGION: Final = (1.2, 0.8)
"""Half size, along x and y, of the region around the stand in which the camera searches for apples.

The unit is the diameter of the largest apple.
"""
TOLERANCE: Final = 0.15
"""Maximum relative deviation of a measured diameter from the sizes in the scene."""
FRESH_S: Final = 0.02
"""Maximum age at which a world state is rendered immediately, in seconds."""
NEXT_S: Final = 1.5 * PERIOD_S
"""Maximum time to wait for the next world state if the latest state is older than ``FRESH_S``, in seconds."""
SMOOTHING: Final = 0.2
"""Weight of the latest interval in the measured rate."""


def grading_settings(camera: SceneCamera) -> GradingSettings:
    """Return the grading settings for a scene.

    Only apples that are on the scene's stand and have a size from the scene are graded.
    """
    x, y, _ = camera.stand_m
    low_mm, high_mm = camera.diameters_mm
    along_m, across_m = (0.001 * share * high_mm for share in REGION)
    return GradingSettings(
        region_m=(x - along_m, y - across_m, x + along_m, y + across_m),
        diameter_mm=(low_mm * (1.0 - TOLERANCE), high_mm * (1.0 + TOLERANCE)),
    )


class VirtualCamera:
    """Camera that renders an emulator's scene. It implements ``perception.frames.CameraSource``."""

    def __init__(self, link: Path, scene: Path, clock: Clock, light: Light | None = None, seed: int = 0) -> None:
        """Prepare the camera. The emulator does not need to run before ``open`` is called.

        Args:
            link: Path of the emulator's bus.
            scene: The MuJoCo file of the emulator, with a camera and apples.
            clock: Clock used for time stamps. The emulator must use the same clock.
            light: Light in the scene. If None, daylight in a room is used.
            seed: Random seed for the image noise.

        Raises:
            ArmFileError: The scene has no camera or no apples.
        """
        self._feed, self._clock = feed_path(link), clock
        self._camera = SceneCamera(scene, light, seed=seed)
        self._client: WorldFeedClient | None = None
        self._next_s = 0.0
        self._number = 0
        self._last_s: float | None = None
        self._interval_s = 0.0

    @property
    def name(self) -> str:
        """Camera name for use in messages."""
        return f"the virtual camera at {self._feed}"

    @property
    def rate_hz(self) -> float:
        """Measured rate of new frames, in Hz; 0.0 before the second frame."""
        return 1.0 / self._interval_s if self._interval_s > 0.0 else 0.0

    @property
    def view(self) -> CameraView:
        """Calibration of the camera. The plane is the top of the stand."""
        camera = self._camera.camera
        intrinsics = Intrinsics.pinhole(camera.focal_px, camera.width, camera.height)
        return CameraView(intrinsics, CameraPose(camera.axes, camera.position_m, self._camera.stand_m[2]))

    @property
    def settings(self) -> GradingSettings:
        """Grading settings for this scene."""
        return grading_settings(self._camera)

    def open(self) -> None:
        """Connect to the emulator. Raises CameraMissing if no emulator runs."""
        try:
            self._client = WorldFeedClient(self._feed)
        except OSError as error:
            raise CameraMissing(
                f"{self.name} cannot connect to the emulator ({error.strerror or error}): start the emulator first"
            ) from error
        self._number, self._last_s, self._interval_s = 0, None, 0.0
        self._next_s = self._clock.now()

    def read(self, timeout_s: float) -> Frame:
        """Wait for the next image, and return it.

        Raises:
            CameraSilent: The emulator did not publish a world state in time.
            CameraLost: The emulator has exited, or the camera is not open.
        """
        deadline_s = self._clock.now() + timeout_s
        self._clock.sleep_until(min(self._next_s, deadline_s))
        publication = self._fresh(deadline_s, timeout_s)
        now_s = self._clock.now()
        # Keep the frame period, unless images were missed.
        self._next_s = max(self._next_s + 1.0 / RATE_HZ, now_s + 0.5 / RATE_HZ)
        self._camera.see(publication)
        stamp_s = self._stamp_s(publication)
        self._count(stamp_s)
        return Frame(self._camera.picture(), stamp_s, self._number)

    def truth(self) -> AppleTruth | None:
        """Return the true state of the apple in the last image, or None if the world has no apples."""
        return self._camera.truth()

    def close(self) -> None:
        """Disconnect. A second call has no effect."""
        if self._client is not None:
            self._client.close()
        self._client = None

    def _fresh(self, deadline_s: float, timeout_s: float) -> Mapping[str, Any]:
        """Return a recent state, so that the image is up to date. Wait for at most one new state."""
        publication = self._newest(deadline_s, timeout_s)
        now_s = self._clock.now()
        if now_s - self._stamp_s(publication) > FRESH_S:
            with suppress(CameraSilent):
                return self._newest(min(deadline_s, now_s + NEXT_S), timeout_s)
        return publication

    def _stamp_s(self, publication: Mapping[str, Any]) -> float:
        """Convert the time of a world state to the camera's clock."""
        trace = publication["trace"]
        return float(trace[-1][0]) if trace else self._clock.now()

    def _newest(self, deadline_s: float, timeout_s: float) -> Mapping[str, Any]:
        """Return the latest unread publication. If there is no unread publication, wait for the next one."""
        while True:
            if self._client is None:
                raise CameraLost(f"{self.name} is not open: call open() first")
            publication = self._client.newest()
            if publication is not None:
                return publication
            if self._client.ended:
                raise CameraLost(f"{self.name} stopped because its emulator has exited: start the emulator again")
            now_s = self._clock.now()
            if now_s >= deadline_s:
                raise CameraSilent(
                    f"{self.name} received no world state for {timeout_s:g} s: check whether the emulator hangs"
                )
            self._clock.sleep_until(min(now_s + POLL_S, deadline_s))

    def _count(self, stamp_s: float) -> None:
        self._number += 1
        if self._last_s is not None:
            interval_s = stamp_s - self._last_s
            known = self._interval_s or interval_s
            self._interval_s = known + SMOOTHING * (interval_s - known)
        self._last_s = stamp_s

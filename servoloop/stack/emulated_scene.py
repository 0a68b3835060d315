"""Emulator scene: latest poses of the objects around the arm. This module does not import the simulation."""

import threading
from collections.abc import Mapping

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion
from sim_backend.scene.world_feed import WorldFeedClient

Pose = tuple[Vector, Quaternion]
"""Position in meters, and orientation as a quaternion x, y, z, w."""


class EmulatedScene:
    """Latest poses published by an emulator. All methods are safe to call from any thread."""

    def __init__(self, client: WorldFeedClient) -> None:
        self._client = client
        self._poses: dict[str, Pose] = {}
        self._lock = threading.Lock()

    def __call__(self) -> Mapping[str, Pose]:
        """Return the poses, keyed by name. The mapping is empty before the first publication."""
        with self._lock:
            newest = self._client.newest()
            if newest is not None:
                self._poses = {
                    name: (tuple(pose["position_m"]), tuple(pose["quaternion_xyzw"]))
                    for name, pose in newest["poses"].items()
                }
            return self._poses

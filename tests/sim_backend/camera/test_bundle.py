"""Bundles of rays: no ray that hits a geom is omitted."""

import numpy as np
import pytest

from sim_backend.camera.bundle import Bundle
from sim_backend.camera.light import Light
from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.camera.view import FixedView, mean_radiance
from sim_backend.scene.rays import cast, visible
from sim_backend.scene.world import World


@pytest.mark.parametrize("eye_m", [(0.6, 0.1, 0.4), (0.35, 0.0, 0.12), (2.0, -6.0, 15.0)])
def test_all_hits_are_near(eye_m):
    world, target_m = World(), np.array([0.2, 0.0, 0.1])
    camera = PinholeCamera.looking_at(target_m, np.array(eye_m), focal_px=80.0, size=(120, 90))
    rays, geoms = camera.rays(), visible(world.model)
    geoms = geoms[world.model.geom_rbound[geoms] > 0.0]
    bundle = Bundle(camera.position_m, rays)
    for geom in geoms:
        hit = np.flatnonzero(cast(world.model, world.data, camera.position_m, rays, [geom])[0] >= 0)
        near = bundle.near(world.model, world.data, np.array([geom]))
        assert np.isin(hit, near).all()
    assert len(bundle.near(world.model, world.data, geoms[:1])) < len(rays)


def test_rays_to_all_sides_are_refused():
    with pytest.raises(ValueError, match="less than 90 degrees"):
        Bundle(np.zeros(3), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -0.1, 0.0]]))


def test_a_moving_arm_leaves_nothing_behind():
    """A picture does not depend on earlier poses, and fixed and moving geoms are combined in one picture."""
    poses = ([-0.4, 0.3, -0.6, -0.8, -0.9, 0.4, 0.02], [0.0, -0.36, -0.64, -0.82, -0.95, -1.68, 0.0])
    worlds = [World(initial_position=pose) for pose in poses]
    camera = PinholeCamera.looking_at(np.array([0.29, 0.0, 0.09]), np.array([0.7, 0.0, 0.4]), 150.0, (160, 120))
    views = [FixedView(world.model, world.data, camera, Light(), {}) for world in worlds]
    for world in worlds:
        first, second = (mean_radiance(list(view.sights(world.data))) for view in views)
        np.testing.assert_array_equal(first, second)

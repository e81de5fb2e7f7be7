"""The simulated studio: is what it draws where its truth says, and is what it hides hidden?"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.studio.cones import RoundCones, first_hits, visible
from perfanim.core.simulate.studio.discs import disc_light, draw_disc
from perfanim.core.simulate.studio.filmed_motion import Performance
from perfanim.core.simulate.studio.performer_body import make_body
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import open_simulated, studio_settings
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from scipy.spatial.distance import cdist

FPS = 60.0
QUIET = StudioSettings(noise_sigma=0.0, clutter=False)


def flying(scene: Any, points_m: np.ndarray) -> Performance:
    """Markers on given paths (F, M, 3), with the body out of sight."""
    frames, count = points_m.shape[:2]
    motion = scene.swinging(frames)
    path = motion.root_positions_m + np.array([0.0, 0.0, 50.0])  # behind the cameras
    base = scene.performed(replace(motion, root_positions_m=path))
    return replace(base, marker_names=tuple(f"M{i}" for i in range(count)), markers_m=points_m)


def centroid(image: np.ndarray, empty: np.ndarray, near: np.ndarray, reach: int = 8) -> np.ndarray:
    """Intensity-weighted centre of what was added to the empty image about a place."""
    x, y = np.rint(near).astype(int)
    window = slice(y - reach, y + reach + 1), slice(x - reach, x + reach + 1)
    light = image[window].astype(float).sum(axis=2) - empty[window].astype(float).sum(axis=2)
    rows, columns = np.mgrid[window]
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()


# --- round cones and the body


@pytest.mark.long
def test_first_hits_agree_with_marching_along_the_rays() -> None:
    rng = np.random.default_rng(1)
    count = 20
    cones = RoundCones(
        rng.uniform(-1, 1, (count, 3)),
        rng.uniform(-1, 1, (count, 3)),
        rng.uniform(0.05, 0.5, count),
        rng.uniform(0.05, 0.5, count),
    )
    origin = np.array([0.0, 0.5, 4.0])
    rays = rng.normal(0, 0.2, (150, 3)) - origin / 4.0
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hits = first_hits(origin, rays, cones)
    share = np.linspace(0.0, 1.0, 401)
    steps = np.linspace(2.0, 6.5, 46)
    places = origin + steps[:, None, None] * rays
    for i in range(count):
        centres = cones.starts[i] + share[:, None] * (cones.ends[i] - cones.starts[i])
        radii = cones.start_radii[i] + share * (cones.end_radii[i] - cones.start_radii[i])
        inside = np.array([(cdist(row, centres) < radii - 1e-6).any(axis=1) for row in places])
        found = np.isfinite(hits[:, i])
        assert not inside[:, ~found].any()
        first = np.where(inside.any(axis=0), steps[np.argmax(inside, axis=0)], np.inf)
        assert np.all(hits[:, i] <= first)
        points = origin + hits[found, i, None] * rays[found]
        gaps = (cdist(points, centres) - radii).min(axis=1)
        assert np.abs(gaps).max(initial=0.0) < 1e-4


def test_cone_behind_the_camera_or_inside_out_is_no_hit() -> None:
    behind = RoundCones(np.array([[0.0, 0, 2]]), np.array([[0.0, 0, 3]]), np.array([0.3]), np.array([0.2]))
    assert np.isinf(first_hits(np.zeros(3), np.array([[0.0, 0.0, -1.0]]), behind)).all()
    ball = RoundCones(np.array([[0.0, 0, -2]]), np.array([[0.0, 0, -2.1]]), np.array([0.5]), np.array([0.1]))
    assert first_hits(np.zeros(3), np.array([[0.0, 0.0, -1.0]]), ball)[0, 0] == pytest.approx(1.5)


def test_body_is_symmetric_and_grows_with_its_skeleton() -> None:
    body = make_body(default_skeleton())
    tall = make_body(default_skeleton(1.925))
    np.testing.assert_allclose(tall.start_radii_m, 1.1 * body.start_radii_m)
    ends = np.concatenate(body.posed(rot.identity((len(body.skeleton),)), np.zeros(3)))
    mirrored = ends * [-1.0, 1.0, 1.0]
    assert max(np.linalg.norm(ends - place, axis=1).min() for place in mirrored) < 1e-9
    assert {len(limb) > 0 for limb in body.limbs} == {True}
    assert sum(len(limb) for limb in body.limbs) == len(body.joints)


def test_unknown_joints_get_a_body_too() -> None:
    tail = Skeleton(("hips", "tail"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 0, -0.1]]), np.zeros((2, 3)) - 0.1)
    assert len(make_body(tail).joints) == 2


def test_marker_is_seen_from_its_own_side_of_a_limb_only() -> None:
    limb = RoundCones(np.array([[-0.5, 1.0, 0.0]]), np.array([[0.5, 1.0, 0.0]]), np.array([0.05]), np.array([0.05]))
    for depth in (0.03, 0.05, 0.07):  # under the skin, on it, on a stalk
        marker = np.array([[0.0, 1.0, depth]])
        assert visible(np.array([0.3, 1.4, 3.0]), marker, limb, 0.006).all()
        assert not visible(np.array([0.3, 1.4, -3.0]), marker, limb, 0.006).any()


def test_body_hides_markers_of_the_far_side(scene: Any) -> None:
    rig = default_rig()
    facing, away = scene.performed(scene.swinging()), scene.performed(scene.swinging(turn=np.pi))
    renderer = Renderer(rig, QUIET)
    assert renderer.render(facing, 0.0, 0).truth.visible.all()
    seen = dict(zip(away.marker_names, renderer.render(away, 0.0, 0).truth.visible.any(axis=0), strict=True))
    assert not seen["LWAI"] and not seen["RWAI"] and not seen["HEAD"]
    free = Renderer(rig, replace(QUIET, occlusion=False))
    assert free.render(away, 0.0, 0).truth.visible.all()


def test_partners_are_seen_and_hide_what_is_behind_them(scene: Any) -> None:
    motion = scene.swinging()

    def moved(x: float, z: float) -> Performance:
        path = motion.root_positions_m + np.array([x, 0.0, z])
        return scene.performed(replace(motion, root_positions_m=path), "locomotion")

    renderer = Renderer(default_rig(), QUIET)
    beside = replace(moved(-0.6, 0.0), partners=(moved(0.6, 0.0),))
    truth = renderer.render(beside, 0.0, 0).truth
    assert truth.visible.shape == (2, 16) and truth.visible.all()
    np.testing.assert_allclose(truth.markers_m[8:] - truth.markers_m[:8], [[1.2, 0.0, 0.0]] * 8, atol=1e-12)
    assert np.all(truth.pixels[:, :8, 0].mean(axis=1) < truth.pixels[:, 8:, 0].mean(axis=1))
    behind = renderer.render(replace(moved(0.0, 0.0), partners=(moved(0.0, -0.5),)), 0.0, 0).truth
    assert behind.visible[:, :8].all()
    assert not behind.visible[:, 8:].all(axis=1).any()  # each camera misses some of the one at the back
    alone = renderer.render(moved(-0.6, 0.0), 0.0, 0).images[0].astype(int)
    added = np.abs(renderer.render(beside, 0.0, 0).images[0].astype(int) - alone).sum(axis=(0, 2))
    assert added[:320].sum() < added[320:].sum()  # the second body is drawn, on the right


def test_partners_perform_beside_the_first() -> None:
    spec = {"behaviour": "boxing", "seconds": 2.0, "partners": [{"behaviour": "walking", "height_m": 1.6}, {}]}
    source = open_simulated(spec)
    first, second, third = source.performance.everybody
    roots_m = [one.motion.root_positions_m[0, 0] for one in (first, second, third)]
    np.testing.assert_allclose(np.diff(roots_m), [1.2, 1.2], atol=0.05)  # a T pose sways by less
    assert second.motion.skeleton.offsets_m[1, 1] != first.motion.skeleton.offsets_m[1, 1]
    assert not np.array_equal(third.motion.rotations, first.motion.rotations)  # not in step
    assert source.frame(0).truth.markers_m.shape == (27, 3)
    with pytest.raises(SettingsError, match=r"performer, partners 1: height_m must be a number from 0\.5 to 3 m"):
        open_simulated({"partners": [{"height_m": 160}]})


def test_sword_is_held_and_does_not_hide_its_own_marker(scene: Any) -> None:
    motion = scene.swinging()
    plain, armed = scene.performed(motion), scene.performed(motion, "kendo")
    assert "wood" not in plain.body.materials and armed.body.materials.count("wood") == 1
    tip = armed.ends_m[:, armed.body.materials.index("wood")]
    np.testing.assert_allclose(tip, armed.markers_m[:, armed.marker_names.index("SWRD")])
    seen = Renderer(default_rig(), QUIET).render(armed, 0.0, 0).truth.visible
    assert seen[:, armed.marker_names.index("SWRD")].all()


def test_marker_hides_the_one_behind_it(scene: Any) -> None:
    rig = default_rig()
    ray = np.array([0.0, 1.0, 0.0]) - rig.cameras[0].centre_m
    points = rig.cameras[0].centre_m + np.outer([1.0, 0.9], ray) + np.array([[0.0, 0.005, 0.0], [0.0, 0.0, 0.0]])
    truth = Renderer(rig, QUIET).render(flying(scene, np.repeat(points[None], 3, axis=0)), 0.0, 0).truth
    assert truth.visible.tolist() == [[False, True], [True, True]]


# --- drawing


@pytest.mark.parametrize("radius", [1.2, 1.9, 3.0])
def test_disc_has_its_centre_and_area(radius: float) -> None:
    rng = np.random.default_rng(2)
    errors = []
    for centre in rng.uniform(15.0, 16.0, (200, 2)):
        left, top, light = disc_light(centre[None], radius, 0.5)
        rows, columns = np.mgrid[top : top + light.shape[0], left : left + light.shape[1]]
        errors.append(np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum() - centre)
        assert light.sum() == pytest.approx(np.pi * radius**2, rel=0.01)
        assert light.max() <= 1.0 + 1e-9
    assert np.abs(np.mean(errors, axis=0)).max() < 0.0005
    assert np.abs(errors).max() < 0.005


def test_disc_at_the_edge_is_cut_off() -> None:
    whole, cut = np.zeros((40, 40, 3), np.uint8), np.zeros((20, 20, 3), np.uint8)
    for image, centre in ((whole, [20.3, 9.8]), (cut, [0.3, -0.2])):
        draw_disc(image, np.array([centre]), 3.0, np.full(3, 200.0), 0.5)
    np.testing.assert_array_equal(cut[:8, :10], whole[10:18, 20:30])
    before = cut.copy()
    draw_disc(cut, np.array([[-30.0, 5.0]]), 3.0, np.full(3, 200.0), 0.5)
    np.testing.assert_array_equal(cut, before)


def test_markers_stand_where_the_truth_says_in_distorted_images(scene: Any) -> None:
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 4), np.linspace(0.4, 1.8, 4)), -1).reshape(-1, 2)
    points = np.column_stack((grid, np.zeros(len(grid)))) + rng.uniform(-0.1, 0.1, (len(grid), 3))
    renderer = Renderer(default_rig(), QUIET)
    frame = renderer.render(flying(scene, np.repeat(points[None], 4, axis=0)), 0.0, 0)
    assert frame.truth.visible.all()
    rays = []
    for i, camera in enumerate(renderer.rig.cameras):
        np.testing.assert_allclose(frame.truth.pixels[i], camera.project(points), atol=1e-9)
        seen = np.array([centroid(frame.images[i], renderer._empty[i], p) for p in frame.truth.pixels[i]])
        # grey levels are whole numbers: that alone moves a centroid by some thousandths
        assert np.abs(seen - frame.truth.pixels[i]).max() < 0.02
        rays.append(camera.rays(camera.undistort(seen)))
    # both rays pass the 3D marker
    for camera, ray in zip(renderer.rig.cameras, rays, strict=True):
        offset = points - camera.centre_m
        assert np.linalg.norm(np.cross(offset, ray), axis=1).max() < 3e-4


def test_discs_are_as_large_as_balls_at_their_distance(scene: Any) -> None:
    renderer = Renderer(default_rig(), replace(QUIET, marker_radius_m=0.02))
    truth = renderer.render(flying(scene, np.full((4, 1, 3), [0.0, 1.0, 0.5])), 0.0, 0).truth
    camera = renderer.rig.cameras[0]
    depth = camera.to_camera([0.0, 1.0, 0.5])[2]
    assert truth.radii_px[0, 0] == pytest.approx(0.02 * camera.focal_px / depth)


def test_exposure_smears_along_the_path_about_the_true_centre(scene: Any) -> None:
    speed = 4.0
    time = np.arange(20)[:, None, None] / FPS
    path = np.array([-0.5, 1.0, 0.0]) + time * np.array([speed, 0.0, 0.0])
    sharp, smeared = Renderer(default_rig(), QUIET), Renderer(default_rig(), replace(QUIET, exposure_s=0.008))
    moment = 7.3 / FPS
    still, moving = (r.render(flying(scene, path), moment, 0) for r in (sharp, smeared))
    np.testing.assert_allclose(moving.truth.pixels, still.truth.pixels)
    camera = sharp.rig.cameras[0]
    ends = camera.project(np.array([-0.5, 1.0, 0.0]) + (moment + np.array([[-0.004], [0.004]])) * [speed, 0.0, 0.0])
    length = np.linalg.norm(ends[1] - ends[0])
    spreads = []
    for frame in (still, moving):
        near = frame.truth.pixels[0, 0]
        assert np.abs(centroid(frame.images[0], sharp._empty[0], near, 14) - near).max() < 0.03
        light = (frame.images[0].astype(float) - sharp._empty[0]).sum(axis=(0, 2))
        spreads.append((light * (np.arange(640) - near[0]) ** 2).sum() / light.sum())
    # evenly spread along a line of that length, the light's variance grows by a twelfth of its square
    assert spreads[1] - spreads[0] == pytest.approx(length**2 / 12.0, rel=0.05)


def test_time_offset_and_rolling_shutter_move_the_centres_in_time(scene: Any) -> None:
    velocity = np.array([3.0, 1.0, 0.0])
    time = np.arange(30)[:, None, None] / FPS
    start = np.array([-0.6, 0.8, 0.0])
    path = start + time * velocity
    rig = default_rig()
    late = Renderer(rig, replace(QUIET, time_offsets_s=(0.0, 0.005)))
    frame = late.render(flying(scene, path), 0.2, 0)
    assert frame.times_s == pytest.approx((0.2, 0.205))
    np.testing.assert_allclose(frame.truth.pixels[1, 0], rig.cameras[1].project(start + 0.205 * velocity), atol=1e-6)
    rolling = Renderer(rig, replace(QUIET, rolling_shutter_s=0.012)).render(flying(scene, path), 0.2, 0).truth
    row = rig.cameras[0].project(start + 0.2 * velocity)[1]
    moment = 0.2 + (row / 480.0 - 0.5) * 0.012
    np.testing.assert_allclose(rolling.pixels[0, 0], rig.cameras[0].project(start + moment * velocity), atol=1e-6)
    assert abs(moment - 0.2) > 1e-4


def test_noise_is_as_strong_as_asked_and_reproducible(scene: Any) -> None:
    sigma = 3.0
    rig = default_rig()
    renderer = Renderer(rig, replace(QUIET, noise_sigma=sigma))
    images = [renderer.background(n)[0].astype(float) - renderer._empty[0] for n in range(3)]
    for difference in images:
        # rounding to whole grey levels adds a twelfth to the variance
        assert difference.std() == pytest.approx(np.hypot(sigma, 12**-0.5), rel=0.02)
        assert abs(difference.mean()) < 0.05
    assert abs(np.corrcoef(images[0].ravel(), images[1].ravel())[0, 1]) < 0.01
    performance = scene.performed(scene.swinging())
    first = renderer.render(performance, 0.1, 6)
    again = Renderer(rig, renderer.settings).render(performance, 0.1, 6)
    other = Renderer(rig, replace(renderer.settings, seed=1)).render(performance, 0.1, 6)
    for a, b, c in zip(first.images, again.images, other.images, strict=True):
        np.testing.assert_array_equal(a, b)
        assert (a != c).mean() > 0.5


def test_body_is_drawn_where_it_is(scene: Any) -> None:
    renderer = Renderer(default_rig(), QUIET)
    performance = scene.performed(scene.swinging())
    frame = renderer.render(performance, 0.3, 0)
    cones = performance.cones_at(0.3)
    middles = 0.5 * (cones.starts + cones.ends)
    for i, camera in enumerate(renderer.rig.cameras):
        changed = (frame.images[i] != renderer._empty[i]).any(axis=2)
        x, y = np.rint(camera.project(middles)).astype(int).T
        assert changed[y, x].all()
        rows, columns = np.nonzero(changed)
        # pixels that nothing of the body reaches stay as they were
        rays = camera.rays(camera.undistort(np.column_stack((columns, rows))))
        grown = RoundCones(cones.starts, cones.ends, cones.start_radii + 0.02, cones.end_radii + 0.02)
        assert np.isfinite(first_hits(camera.centre_m, rays, grown)).any(axis=1).mean() > 0.995


def test_ghosts_dropout_moved_object_and_light(scene: Any) -> None:
    performance = scene.performed(scene.swinging())
    haunted = Renderer(default_rig(), replace(QUIET, ghosts=3, draw_body=False))
    seen = 0
    for number in range(20):
        frame = haunted.render(performance, number * 0.9, number)
        for i, ghosts in enumerate(frame.truth.ghosts):
            for x, y in np.rint(ghosts).astype(int):
                seen += 1
                assert frame.images[i][y, x].min() > 150
    assert seen > 40
    forgetful = Renderer(default_rig(), replace(QUIET, dropout=0.3))
    lost = 1.0 - np.mean([forgetful.render(performance, 0.0, n).truth.visible for n in range(60)])
    assert lost == pytest.approx(0.3, abs=3.0 * np.sqrt(0.3 * 0.7 / (60 * 18)))
    changed = Renderer(default_rig(), replace(QUIET, moved_object=True, draw_body=False, occlusion=False))
    image = changed.render(flying(scene, np.full((2, 1, 3), [0.0, 1.0, 0.0])), 0.0, 0).images[0]
    assert (image != changed.background(0)[0]).any(axis=2).sum() > 500
    bright = Renderer(default_rig(), replace(QUIET, light_drift=0.1, draw_body=False))
    ratio = bright.render(performance, np.pi, 0).images[0].mean() / bright._empty[0].mean()
    assert ratio == pytest.approx(1.1, abs=0.01)


def test_rooms_differ_between_cameras_and_lamps_shine() -> None:
    renderer = Renderer(default_rig(), StudioSettings(noise_sigma=0.0))
    left, right = renderer.background(0)
    assert np.abs(left.astype(int) - right).mean() > 5.0
    x, y = np.rint(renderer.rig.cameras[0].project([2.56, 1.98, -2.3])).astype(int)
    assert left[y, x].min() > 225


@pytest.mark.parametrize(
    "wrong", [{"noise_sigma": -1.0}, {"dropout": 1.5}, {"exposure_s": float("nan")}, {"ghosts": 99}]
)
def test_settings_out_of_range(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        studio_settings(wrong)


def test_unknown_setting() -> None:
    with pytest.raises(SettingsError, match="fog"):
        studio_settings({"fog": 1})

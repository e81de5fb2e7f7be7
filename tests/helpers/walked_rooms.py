"""Rooms with cameras, and what they would see of a person who walks about or of markers that are waved."""

from itertools import combinations

import numpy as np
from perfanim.core.body.body_size import girth_scale
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import DEFAULT_HEIGHT_M
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.camera import Camera
from perfanim.core.geometry.rigid_transform import kabsch, transform
from perfanim.core.geometry.triangulation import triangulate
from perfanim.core.markers.exchanged_throughout import other_sides
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_keypoints import KeypointErrors, keypoint_errors, own_offsets
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import looking_at
from perfanim.core.vision.calibration.calibrate import calibrate_from_points
from perfanim.core.vision.calibration.calibration_board import BoardView
from perfanim.core.vision.calibration.rig_fit import CameraViews

POINTS = load_marker_set("blazepose-33")
OTHERS = other_sides(POINTS.markers)
FPS = 30.0
# errors of 30 mm, 17 mm along each axis, that differ from camera to camera
ERRORS = KeypointErrors(slow_m=0.030 / np.sqrt(3.0))
MISSING, EXCHANGED = 0.05, 0.2  # shares of points, and of one camera's pictures
SIGMA_SHARE, PERSON_M = 0.012, 2.2  # as the network says: standard deviation by the side of the person's crop


def room(seed: int, cameras: int = 2, apart_deg: tuple[float, float] = (60.0, 110.0)) -> list[Camera]:
    """Return cameras of 640x480 pixels that look at the middle of a room from 3.2 to 4.5 m."""
    random = np.random.default_rng(seed)
    first, apart = np.radians(random.uniform(0.0, 360.0)), np.radians(random.uniform(*apart_deg))
    found = []
    for number in range(cameras):
        angle, far_m = first + number * apart, random.uniform(3.2, 4.5)
        place = np.array([far_m * np.sin(angle), random.uniform(1.0, 2.2), far_m * np.cos(angle)])
        roll = rot.to_matrix(rot.from_rotation_vector(np.array([0.0, 0.0, random.normal(0.0, 0.03)])))
        rotation = roll @ looking_at(place, random.normal((0.0, 0.95, 0.0), 0.12))
        focal, k1 = 640.0 * random.uniform(0.75, 0.95), random.uniform(-0.15, 0.05)
        centre = np.array([319.5, 239.5]) + random.normal(0.0, 5.0, 2)
        matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
        lens = np.array([k1, -0.5 * k1, 0.0, 0.0, 0.0])
        found.append(Camera(f"cam{number + 1}", (640, 480), matrix, lens, rotation, -rotation @ place))
    return found


def height_m(motion: Motion) -> float:
    """Return the height of a motion's performer."""
    return DEFAULT_HEIGHT_M * girth_scale(motion.skeleton)


def walk(motion: Motion, seconds: float, seed: int = 0, fps: float = FPS) -> Array:
    """Return the true points (F, K, 3) of a person with offsets of their own, around the middle of the room."""
    points = POINTS.with_offsets(POINTS.offsets_m + own_offsets(len(POINTS), np.random.default_rng(seed)))
    step = max(1, round(motion.fps / fps))
    found = simulate_markers(motion, points)[0].positions_m[::step][: round(seconds * fps)]
    middle = 0.5 * (found.min(axis=(0, 1)) + found.max(axis=(0, 1)))
    return found - middle * [1.0, 0.0, 1.0]


def person_frames(
    cameras: list[Camera], points_m: Array, seed: int = 0, late: dict[int, int] | None = None, fps: float = FPS
) -> list[MarkerFrame]:
    """Return what a body network finds: errors of each camera's own, missing points, exchanged sides in one camera.

    Args:
        late: Number of frames by which cameras are late, by index.
    """
    random = np.random.default_rng(seed)
    frames, count = points_m.shape[:2]
    table = []
    for number, camera in enumerate(cameras):
        true = points_m[np.maximum(np.arange(frames) - (late or {}).get(number, 0), 0)]
        seen = true + keypoint_errors(frames, count, fps, random, ERRORS)
        rows = np.zeros((frames, count, 5), dtype=np.float32)
        rows[..., :2] = np.nan_to_num(camera.project(seen))
        depth_m = np.median(camera.to_camera(true)[..., 2], axis=1)
        rows[..., 2] = (SIGMA_SHARE * PERSON_M * camera.focal_px / depth_m)[:, None]
        rows[..., 3] = 255.0 * (camera.shows(true) & (random.random((frames, count)) > MISSING))
        if number == 0:
            exchanged = np.zeros(frames, dtype=bool)
            while exchanged.mean() < EXCHANGED:
                start = int(random.integers(frames))
                exchanged[start : start + 1 + int(random.exponential(0.3 * fps))] = True
            rows[exchanged] = rows[exchanged][:, np.where(OTHERS >= 0, OTHERS, np.arange(count))]
        table.append(rows)
    return [MarkerFrame(n, n / fps, blobs=tuple(rows[n] for rows in table)) for n in range(frames)]


def film_frames(
    camera: Camera, number: int, points_m: Array, fps: float, start_s: float, film_fps: float, seed: int | None
) -> list[MarkerFrame]:
    """Return what a body network finds in a film by camera `number` of two, with times from the film's own start.

    Args:
        points_m: True points (F, K, 3), `fps` a second, of which the film shows those from `start_s` on.
        seed: Seed of the errors; None for exact points.
    """
    times_s = np.arange(start_s, (len(points_m) - 2) / fps, 1.0 / film_fps)
    before = np.floor(times_s * fps).astype(int)
    share = (times_s * fps - before)[:, None, None]
    shown = (1.0 - share) * points_m[before] + share * points_m[before + 1]
    if seed is None:
        rows = np.full((len(shown), len(POINTS), 5), (0.0, 0.0, 5.0, 255.0, 0.0), dtype=np.float32)
        rows[..., :2] = camera.project(shown)
    else:
        rows = np.array([frame.blobs[0] for frame in person_frames([camera], shown, seed, fps=film_fps)])
    nobody = np.empty((0, 5), dtype=np.float32)
    return [
        MarkerFrame(
            n,
            n / film_fps,
            blobs=(row, nobody) if number == 0 else (nobody, row),
            camera_times_s=np.where(np.arange(2) == number, n / film_fps, np.nan),
        )
        for n, row in enumerate(rows)
    ]


def waved(seconds: float, seed: int, markers: int = 1, length_m: float = 0.5) -> Array:
    """Return the positions (F, M, 3) of one marker, or two on a stick, waved through the middle of a room."""
    random = np.random.default_rng(seed)
    times_s = np.arange(round(seconds * FPS)) / FPS
    phases, rates = random.uniform(0.0, 2.0 * np.pi, (2, 6)), random.uniform(0.5, 3.0, (2, 6))
    waves = np.sin(times_s[:, None] * rates[0] + phases[0])
    middle = [0.0, 1.1, 0.0] + waves[:, :3] * [0.9, 0.7, 0.9]
    along = np.sin(times_s[:, None] * rates[1, :3] + phases[1, :3]) + np.array((0.0, 0.3, 0.0))
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([middle + side * length_m * along for side in ((0.0,) if markers == 1 else (-0.5, 0.5))], axis=1)


def marker_frames(cameras: list[Camera], points_m: Array, noise_px: float, seed: int = 0) -> list[MarkerFrame]:
    """Return the blobs that cameras see, in random order."""
    random = np.random.default_rng(seed)
    found = []
    for number, points in enumerate(points_m):
        blobs = []
        for camera in cameras:
            rows = np.zeros((len(points), 5), dtype=np.float32)
            rows[:, :2] = camera.project(points) + random.normal(0.0, noise_px, (len(points), 2))
            rows[:, 2:] = (3.0, 200.0, 20.0)
            blobs.append(random.permutation(rows[camera.shows(points)]))
        found.append(MarkerFrame(number, number / FPS, blobs=tuple(blobs)))
    return found


def angles_and_distances(found: list[Camera], truth: list[Camera]) -> tuple[Array, Array]:
    """Return the errors of the angles (P,) between each two cameras, degrees, and of their distances (P,), relative."""
    turned, apart = (
        [[b.rotation @ a.rotation.T for a, b in combinations(each, 2)] for each in (found, truth)],
        [[np.linalg.norm(a.centre_m - b.centre_m) for a, b in combinations(each, 2)] for each in (found, truth)],
    )
    angles = rot.angle_between(*(rot.from_matrix(np.array(each)) for each in turned))
    return np.degrees(angles), np.array(apart[0]) / np.array(apart[1]) - 1.0


def middle_error_m(found: list[Camera], truth: list[Camera], points_m: Array, pixels: Array) -> float:
    """Return the RMS error of points (N, 3) that cameras see at `pixels` (N, C, 2), after the best rigid motion."""
    seen = np.stack([camera.undistort(pixels[:, c]) for c, camera in enumerate(found)], axis=1)
    located = triangulate(found, seen, np.ones(seen.shape[:2]), 1.0)[0]
    apart = transform(*kabsch(located, points_m), located) - points_m
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def middle_of_the_room(cameras: list[Camera], noise_m: float, seed: int = 0) -> tuple[Array, Array]:
    """Return points (N, 3) in the middle of a room, and where cameras (N, C, 2) see them with errors of their own."""
    random = np.random.default_rng(seed)
    points = random.uniform((-0.5, 0.3, -0.5), (0.5, 1.7, 0.5), (400, 3))
    return points, np.stack(
        [each.project(points + random.normal(0.0, noise_m, points.shape)) for each in cameras], axis=1
    )


def by_board(cameras: list[Camera], seed: int = 0) -> list[Camera]:
    """Return the cameras as a board of 9x6 corners, 60 mm apart, calibrates them in 24 places, with 0.2 px of noise."""
    random, (toward, up) = (
        np.random.default_rng(seed),
        (np.mean([c.centre_m for c in cameras], axis=0), [0.0, 1.0, 0.0]),
    )
    flat = np.stack((*np.meshgrid(np.arange(9) * 0.06, np.arange(6) * 0.06), np.zeros((6, 9))), axis=-1).reshape(-1, 3)
    views: list[dict[str, BoardView]] = [{} for _ in cameras]
    for number in range(24):
        place = random.uniform((-0.6, 0.6, -0.6), (0.6, 1.6, 0.6))
        normal = toward - place + random.normal(0.0, 1.0, 3)
        across = np.cross(up, normal)
        axes = np.stack((across, np.cross(normal, across), normal))
        board = place + (flat - flat.mean(axis=0)) @ (axes / np.linalg.norm(axes, axis=1, keepdims=True))
        for camera, seen in zip(cameras, views, strict=True):
            if camera.shows(board).all():
                pixels = camera.project(board) + random.normal(0.0, 0.2, (len(board), 2))
                seen[f"{number:02d}"] = BoardView(np.arange(len(board)), pixels)
    rows = [CameraViews(c.name, c.image_size, seen) for c, seen in zip(cameras, views, strict=True)]
    return list(calibrate_from_points(flat, rows, left_right=False).rig.cameras)

"""Windows of half a second as a network sees them, with its targets."""

from typing import NamedTuple

import numpy as np
from perfanim.core.body.mirroring import mirrored_points
from perfanim.core.body.standard_skeleton import JOINT_NAMES, mirrored_name
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, FloatArray, IntArray, Mask
from perfanim.core.solver.motion_prior import marker_features

from .motion import Recordings
from .performers import FEW, LEG, MANY, PerformerMaker, Performers

LAGS_S = (0.0, 1 / 60, 1 / 30, 0.05, 0.1, 0.2, 0.35, 0.5)
WINDOWS = 8  # windows per performer
_RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 60.0, 60.0, 90.0, 100.0, 120.0, 120.0)
_LAG_TOLERANCE = 0.3  # as in the solver's history
_CARRIED_BY_ROOT = 4.0  # weight of markers on the root, as in the solver
_MANY_SHARE = 0.2  # share of batches with suits of many markers
_OTHER_SIDE = np.array([JOINT_NAMES.index(mirrored_name(name)) for name in JOINT_NAMES])
_THORAX = JOINT_NAMES.index("thorax")
_LEFT_ARM = np.arange(JOINT_NAMES.index("lclavicle"), JOINT_NAMES.index("lthumb") + 1)
_ARMS = np.concatenate((_LEFT_ARM, _OTHER_SIDE[_LEFT_ARM]))
_BORROWED_SHARE = 0.25  # share of performers with one arm or both taken from another frame
# share of performers filmed by one camera, and share with some markers that only one camera sees
_ONE_CAMERA_SHARE, _SOME_SHARE = 0.05, 0.2
_DEPTH_M = (0.004, 0.06)  # standard deviations of the error of points along a ray
_BETWEEN = 4  # lags that are interpolated between frames; for longer ones the nearest frame is enough
_MATRIX_SIGNS = np.outer((-1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)).astype(np.float32)
_VECTOR_SIGNS = np.array([1.0, -1.0, -1.0], dtype=np.float32)


class Batch(NamedTuple):
    """Windows of G performers, N each."""

    features: FloatArray  # (G, N, M, F) from `marker_features`
    seen: Mask  # (G, N, M) markers seen at any of the times
    joints: IntArray  # (G, M)
    bones: FloatArray  # (G, J - 1) lengths, metres
    targets: FloatArray  # (G, N, 6 + 3 (J - 1)) rotation and position of the root in the body frame, and pose


class _Played(NamedTuple):
    """Motion assigned to performers."""

    frames: IntArray  # (G, N) frames of the recordings
    others: IntArray  # (G, N) frames from which arms are borrowed, for combinations that no one recorded
    borrowed: Mask  # (G, A) which of `_ARMS` are borrowed
    mirrored: Mask  # (G,)


class WindowMaker:
    """Draws windows of recordings played by random performers."""

    def __init__(self, recordings: Recordings, makers: PerformerMaker) -> None:
        self._of, self._performers = recordings, makers
        counts = np.bincount(recordings.subject_of_frame)
        weights = (1.0 / np.sqrt(counts))[recordings.subject_of_frame]
        self._cumulative = np.cumsum(weights / weights.sum())
        self._parents = recordings.skeletons[0].parents
        of_bodies = [np.linalg.norm(body.offsets_m[LEG], axis=-1).sum() for body in recordings.skeletons]
        self._leg_of_frame = np.array(of_bodies, dtype=np.float32)[recordings.skeleton_of_frame]
        mean = rot.to_matrix(recordings.mean_rotations)
        mean[0] = np.eye(3)
        for joint in range(1, len(mean)):
            mean[joint] = mean[self._parents[joint]] @ mean[joint]
        self._mean_world = mean.astype(np.float32)

    def draw(self, generator: np.random.Generator, performers: int) -> Batch:
        """Return windows for this many performers."""
        places = MANY if generator.random() < _MANY_SHARE else FEW
        people = self._performers.draw(generator, performers, places)
        played = self._play(generator, performers)
        shape = played.frames.shape
        points, known = self._points(generator, people, played)
        (root, at), poses = self._present(people, played)
        points, single = self._by_one_camera(generator, self._disturb(generator, people, points, known))
        rest = self._rest(people)
        frame, origin = _body_frame(generator, people, points[:, :, 0], rest, (root, at))
        inside = (points - origin[:, :, None, None]) @ frame[:, :, None]
        rests, offsets = (np.broadcast_to(x[:, None], (*shape, places, 3)) for x in (rest, people.believed_offsets_m))
        features = marker_features(inside, single, rests, offsets, np.array(LAGS_S)).astype(np.float32)
        turn = np.swapaxes(frame, -1, -2) @ root
        target = np.concatenate((
            rot.to_rotation_vector(rot.from_matrix(turn)),
            ((at - origin)[:, :, None] @ frame)[:, :, 0],
            poses.reshape(*shape, -1),
        ), axis=-1)  # fmt: skip
        seen = np.isfinite(points[..., 0]).any(axis=2)
        bones = np.linalg.norm(people.believed_bones_m[:, 1:], axis=-1)
        return Batch(features, seen, people.joints, bones, target.astype(np.float32))

    def _play(self, generator: np.random.Generator, performers: int) -> _Played:
        frames, others = (
            np.searchsorted(self._cumulative, generator.random((performers, WINDOWS)))
            .clip(max=len(self._cumulative) - 1)
            for _ in range(2)
        )  # fmt: skip
        chance = generator.random(performers)
        left, right = chance < 2 / 3 * _BORROWED_SHARE, (chance > 1 / 3 * _BORROWED_SHARE) & (chance < _BORROWED_SHARE)
        borrowed = left[:, None] * np.isin(_ARMS, _LEFT_ARM) | right[:, None] * ~np.isin(_ARMS, _LEFT_ARM)
        return _Played(frames, others, borrowed, generator.random(performers) < 0.5)

    def _points(self, generator: np.random.Generator, people: Performers, played: _Played) -> tuple[FloatArray, Mask]:
        """Return markers (G, N, L, M, 3), and whether each time is known (G, N, L)."""
        count, frames = len(played.frames), played.frames
        speed = np.exp(generator.uniform(np.log(0.8), np.log(1.25), (count, 1, 1))) * np.ones_like(frames)[..., None]
        rate = generator.choice(_RATES, (count, 1, 1))
        lags = np.array(LAGS_S)
        taken = np.round(lags * rate) / rate
        known = np.abs(taken - lags) <= _LAG_TOLERANCE * lags
        back = taken * speed * self._of.fps
        starts = np.where(generator.random(frames.shape) < 0.1, generator.random(frames.shape) * 30.0, np.inf)
        known = known & (back <= np.minimum(frames - self._of.starts[frames], starts)[..., None])
        back = np.where(known, back, 0.0)
        whole = np.floor(back).astype(np.int64)
        whole[..., _BETWEEN:] = np.round(back[..., _BETWEEN:])
        points = self._markers(people, played, whole)
        share = (back - whole)[..., 1:_BETWEEN, None, None].astype(np.float32)
        earlier = self._markers(people, played, whole[..., 1:_BETWEEN] + 1)
        points[:, :, 1:_BETWEEN] = (1.0 - share) * points[:, :, 1:_BETWEEN] + share * earlier
        return points, known

    def _present(self, people: Performers, played: _Played) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
        """Return the root's rotation (G, N, 3, 3) and position, and the pose."""
        world, at = self._world(people, played, np.zeros((*played.frames.shape, 1), dtype=np.int64))
        poses = self._of.poses[played.frames]
        arms = self._of.poses[played.others][..., _ARMS - 1, :]
        poses[..., _ARMS - 1, :] = np.where(played.borrowed[:, None, :, None], arms, poses[..., _ARMS - 1, :])
        poses[played.mirrored] = poses[played.mirrored][..., _OTHER_SIDE[1:] - 1, :] * _VECTOR_SIGNS
        return (world[:, :, 0, 0], at[:, :, 0]), poses

    def _world(self, people: Performers, played: _Played, back: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return world matrices (G, N, L, J, 3, 3) and root positions this many frames ago."""
        frames = np.maximum(played.frames[..., None] - back, self._of.starts[played.frames][..., None])
        world, at = self._of.world[frames], self._of.root_positions_m[frames]
        of = np.flatnonzero(played.borrowed.any(axis=1))
        others = played.others[of]
        lent = self._of.world[np.maximum(others[..., None] - back[of], self._of.starts[others][..., None])]
        turn = world[of][..., _THORAX, :, :] @ np.swapaxes(lent[..., _THORAX, :, :], -1, -2)
        chosen = played.borrowed[of][:, None, None, :, None, None]
        own = world[of]
        own[..., _ARMS, :, :] = np.where(chosen, turn[..., None, :, :] @ lent[..., _ARMS, :, :], own[..., _ARMS, :, :])
        world[of] = own
        world[played.mirrored] = world[played.mirrored][..., _OTHER_SIDE, :, :] * _MATRIX_SIGNS
        at[played.mirrored] = mirrored_points(at[played.mirrored])
        return world, at * (people.leg_m[:, None, None] / self._leg_of_frame[frames])[..., None]

    def _markers(self, people: Performers, played: _Played, back: IntArray) -> FloatArray:
        world, at = self._world(people, played, back)
        return _placed(world, at, people.bones_m, people.joints, people.offsets_m, self._parents)

    def _rest(self, people: Performers) -> FloatArray:
        """Return the believed markers (G, M, 3) in the mean pose."""
        world = np.broadcast_to(self._mean_world, (len(people.joints), 1, 1, *self._mean_world.shape))
        at = np.zeros((len(people.joints), 1, 1, 3), dtype=np.float32)
        body = (people.believed_bones_m, people.joints, people.believed_offsets_m)
        return _placed(world, at, *body, self._parents)[:, 0, 0]

    def _disturb(
        self, generator: np.random.Generator, people: Performers, points: FloatArray, known: Mask
    ) -> FloatArray:
        """Return markers with noise, NaN where hidden."""
        count, windows, _, places, _ = points.shape
        noise = np.where(generator.random(count) < 0.35, 0.0, generator.uniform(0.0, 0.005, count))
        gaps = np.where(generator.random(count) < 0.5, 0.0, generator.uniform(0.0, 0.35, count))
        points = points + noise[:, None, None, None, None] * generator.normal(size=points.shape)
        # at most one gap per marker, which may include the current frame
        begin = generator.uniform(-0.15, 0.5, (count, windows, 1, places))
        length = generator.exponential(0.25, begin.shape)
        times = np.array(LAGS_S)[:, None]
        hidden = (times >= begin) & (times <= begin + length)
        hidden &= generator.random((count, windows, 1, places)) < 2.0 * gaps[:, None, None, None]
        hidden |= generator.random((count, windows, 1, places)) < 0.15 * gaps[:, None, None, None]
        hidden |= ~people.worn[:, None, None] | ~known[..., None]
        points[hidden] = np.nan
        return points.astype(np.float32)

    def _by_one_camera(self, generator: np.random.Generator, points: FloatArray) -> tuple[FloatArray, Mask]:
        """Return markers (G, N, L, M, 3), and those (G, N, M) that only one camera sees now.

        Their errors lie along that camera's rays. Either they were hidden for a while before, or there is only one
        camera: then the errors of all markers have a part in common and change slowly.
        """
        count, windows, lags, places, _ = points.shape
        chance = generator.random(count)
        alone, some = chance < _ONE_CAMERA_SHARE, chance > 1.0 - _SOME_SHARE
        share = np.where(alone, 1.0, some * generator.uniform(0.05, 0.6, count))
        single = generator.random((count, windows, places)) < share[:, None, None]
        single &= np.isfinite(points[:, :, 0, :, 0])
        azimuth = generator.uniform(-np.pi, np.pi, (count, windows))
        elevation = generator.normal(0.0, 0.2, (count, windows))
        level = np.cos(elevation)
        ray = np.stack((level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)), axis=-1)
        least, most = np.log(_DEPTH_M)
        depth_m = np.exp(generator.uniform(least, most, (count, 1, 1, 1)))
        off = depth_m * generator.normal(size=(count, windows, 1, places))
        wander = np.sqrt(np.array(LAGS_S))[:, None] * generator.normal(size=(count, windows, lags, places))
        common = depth_m * generator.normal(size=(count, windows, 1, 1))
        off = np.where(alone[:, None, None, None], common + off + 0.3 * depth_m * wander, off)
        moved = single[:, :, None] & ((np.arange(lags) == 0)[:, None] | alone[:, None, None, None])
        points = points + np.where(moved, off, 0.0)[..., None] * ray[:, :, None, None]
        length = generator.exponential(0.3, (count, windows, 1, places))
        unseen = single[:, :, None] & ~moved & (np.array(LAGS_S)[:, None] <= length)
        points[unseen] = np.nan
        return points.astype(np.float32), single


def _placed(
    world: FloatArray, at: FloatArray, bones: FloatArray, joints: IntArray, offsets: FloatArray, parents: IntArray
) -> FloatArray:
    """Return markers (G, N, L, M, 3) for world matrices (G, N, L, J, 3, 3)."""
    moved = (world[..., parents[1:], :, :] @ bones[:, None, None, 1:, :, None])[..., 0]
    positions = np.empty((*world.shape[:4], 3), dtype=np.float32)
    positions[..., 0, :] = at
    for joint in range(1, positions.shape[3]):
        positions[..., joint, :] = positions[..., parents[joint], :] + moved[..., joint - 1, :]
    groups = np.arange(len(joints))[:, None]
    carried = np.moveaxis(world, 3, 1)[groups, joints]  # shape (G, M, N, L, 3, 3)
    markers = np.moveaxis(positions, 3, 1)[groups, joints] + (carried @ offsets[:, :, None, None, :, None])[..., 0]
    return np.moveaxis(markers, 1, 3)


def _body_frame(
    generator: np.random.Generator,
    people: Performers,
    points: FloatArray,
    rest: FloatArray,
    true: tuple[FloatArray, FloatArray],
) -> tuple[Array, Array]:
    """Return world-from-body matrices and origins, (G, N, ...).

    As in `root_from_torso`: if fewer than three torso markers are visible, the last root is shifted, with an error.
    """
    seen = np.isfinite(points[..., 0])
    torso = seen & people.torso[:, None]
    enough = torso.sum(axis=-1) >= 3
    weights = torso * np.where(people.joints == 0, _CARRIED_BY_ROOT, 1.0)[:, None]
    weights = weights / np.maximum(weights.sum(axis=-1, keepdims=True), 1e-9)
    filled = np.where(seen[..., None], points, 0.0).astype(np.float64)
    source = np.broadcast_to(rest[:, None], filled.shape).astype(np.float64)
    source_mean, target_mean = (np.einsum("gnm,gnmi->gni", weights, each) for each in (source, filled))
    cross = np.einsum(
        "gnm,gnmi,gnmj->gnij", weights, source - source_mean[:, :, None], filled - target_mean[:, :, None]
    )
    u, _, vt = np.linalg.svd(cross)
    sign = np.sign(np.linalg.det(np.swapaxes(u @ vt, -1, -2)))
    middle = np.ones((*sign.shape, 3))
    middle[..., 2] = sign
    frame = np.swapaxes(vt, -1, -2) @ (middle[..., None] * np.swapaxes(u, -1, -2))
    off = rot.to_matrix(rot.from_rotation_vector(generator.normal(0.0, 0.06, source_mean.shape)))
    frame = np.where(enough[..., None, None], frame, true[0] @ off)
    shares = np.where(enough[..., None], weights, seen / np.maximum(seen.sum(axis=-1, keepdims=True), 1))
    turned = np.einsum("gnij,gmj->gnmi", frame, rest)
    origin = np.einsum("gnm,gnmi->gni", shares, filled - turned)
    nothing = ~seen.any(axis=-1)
    origin[nothing] = true[1][nothing] + generator.normal(0.0, 0.03, origin[nothing].shape)
    return frame, origin

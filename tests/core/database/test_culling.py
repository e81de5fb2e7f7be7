import numpy as np
from perfanim.core.body.motion import resampled
from perfanim.core.database.culling import JOINT_ANGLES, clips_after_culling, near_duplicates
from perfanim.core.database.store import Clip
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION

FPS = 60.0


def poses_of(pattern: str) -> np.ndarray:
    """(F, D) rotation vectors of a shipped clip."""
    motion = resampled(read_motion(next(MOTION.glob(pattern))), FPS)
    return rot.to_rotation_vector(motion.rotations[:, 1:]).reshape(motion.frames, -1).astype(np.float32)


def together(parts: list[np.ndarray]) -> tuple[np.ndarray, list[Clip]]:
    edges = np.concatenate(([0], np.cumsum([len(part) for part in parts])))
    clips = [Clip(str(i), "", "", 120.0, int(edges[i]), int(edges[i + 1]), 0) for i in range(len(parts))]
    return np.concatenate(parts), clips


def shifted(poses: np.ndarray, rms_deg: float) -> np.ndarray:
    """Poses that lie `rms_deg` from these, root mean square over the joint angles."""
    direction = np.random.default_rng(0).normal(size=poses.shape[1])
    direction *= np.radians(rms_deg) * np.sqrt(JOINT_ANGLES) / np.linalg.norm(direction)
    return (poses + direction).astype(np.float32)


def test_a_passage_held_by_an_earlier_clip_goes_and_another_stays() -> None:
    walk, box = poses_of("walking-01*.bvh"), poses_of("boxing-01*.bvh")
    poses, clips = together([walk, box, shifted(walk, 0.9), shifted(walk, 1.2), shifted(box, 0.5)])
    culled = near_duplicates(poses, clips, FPS, 1.0)
    shares = [culled[clip.start : clip.stop].mean() for clip in clips]
    assert shares[:2] == [0.0, 0.0]  # what moves alike within a clip stays
    assert shares[2] == shares[4] == 1.0
    assert shares[3] < 0.1  # its own distance is above; other phases of the walk may be nearer


def test_only_the_part_that_is_known_goes() -> None:
    walk, box = poses_of("walking-01*.bvh")[:200], poses_of("boxing-01*.bvh")[:200]
    poses, clips = together([walk, np.concatenate((box, walk[50:150], box[::-1]))])
    culled = near_duplicates(poses, clips, FPS, 0.5)[len(walk) :]
    assert not culled[:200].any()
    assert not culled[300:].any()
    assert culled[212:280].all()  # margins and the look ahead stay
    kept = clips_after_culling(clips, np.concatenate((np.zeros(len(walk), dtype=bool), culled)), FPS)
    assert [clip.name for clip in kept] == ["0", "1", "1"]
    assert [clip.start for clip in kept[1:]] == [clip.stop for clip in kept[:-1]]
    assert kept[2].stop == len(poses) - culled.sum()
    begins = len(culled) - (kept[2].stop - kept[2].start)
    assert kept[2].first_frame == 2 * begins  # the source has twice the rate


def test_the_same_poses_backwards_are_another_motion() -> None:
    run = poses_of("running-01*.bvh")
    poses, clips = together([run, run[::-1].copy()])
    assert near_duplicates(poses, clips, FPS, 0.5).mean() < 0.05


def test_nothing_is_culled_that_is_far_from_all_that_is_kept() -> None:
    """Every frame that was looked at lies within the distance of a kept one, by an exhaustive search."""
    parts = [poses_of(f"walking-0{i}*.bvh") for i in (1, 5, 6)]
    poses, clips = together([*parts, shifted(parts[0], 0.3)])
    limit = 4.0
    culled = near_duplicates(poses, clips, FPS, limit)
    assert 0 < culled.sum() < len(poses) - len(parts[0])
    kept = poses[~culled].astype(np.float64)
    looked_at = np.concatenate([np.arange(clip.start, clip.stop - 6, 3) for clip in clips])  # 20 a second
    looked_at = looked_at[culled[looked_at]]
    apart = [np.sqrt(np.min(np.sum((kept - pose) ** 2, axis=1)) / JOINT_ANGLES) for pose in poses[looked_at]]
    # the distance is that of two poses together: one of them alone may be further by the root of two
    assert np.degrees(max(apart)) <= np.sqrt(2.0) * limit


def test_clips_shorter_than_the_look_ahead_stay() -> None:
    walk = poses_of("walking-01*.bvh")
    poses, clips = together([walk, walk[:5]])
    assert not near_duplicates(poses, clips, FPS, 1.0).any()

"""Takes whose frames come at random times, and the motion that they show at any time."""

from dataclasses import dataclass, replace

import numpy as np
from perfanim.core.body.scene_pose import PropPose, ScenePose
from perfanim.core.body.skeleton import forward_kinematics, marker_positions
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set

from .solved_poses import performer_pose

SKELETON = default_skeleton()
HAND = SKELETON.index("lhand")
SUIT = load_marker_set("boxing")
HAND_MARKER = SUIT.names.index("LHAN")


@dataclass(frozen=True)
class Series:
    """Times of frames, as they were and as a file has them, and the rate that its header states."""

    true_s: np.ndarray
    written_s: np.ndarray
    stated_fps: float


def random_series(seed: int) -> Series:
    """Return times 10 to 70 ms apart, or of a steady rate with losses; some rounded, some under a wrong header."""
    rng = np.random.default_rng(seed)
    fps = float(rng.choice([25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 30000.0 / 1001.0]))
    if seed % 2:
        times_s = np.concatenate(([0.0], np.cumsum(rng.uniform(0.010, 0.070, rng.integers(40, 120)))))
    else:
        frames = np.arange(rng.integers(40, 120))
        kept = rng.random(len(frames)) > rng.choice([0.0, 0.05, 0.3])
        kept[[0, 1, -1]] = True
        times_s = frames[kept] / fps
    times_s = times_s + rng.choice([0.0, 3.7])
    written_s = np.round(times_s, 3) if rng.random() < 0.5 else times_s
    return Series(times_s, written_s, float(rng.choice([fps, fps, 60.0, 1.3 * fps])))


def poses_at(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (F, J, 4) and root positions (F, 3), metres, of a body that waves and walks."""
    rotations = np.tile(rot.identity((len(SKELETON),)), (len(times_s), 1, 1))
    wave = np.zeros((len(times_s), 3))
    wave[:, 2] = 0.8 * np.sin(2.0 * np.pi * 0.7 * times_s)
    rotations[:, SKELETON.index("lhumerus")] = rot.from_rotation_vector(wave)
    turn = np.zeros_like(wave)
    turn[:, 1] = 0.6 * np.sin(2.0 * np.pi * 0.3 * times_s)
    rotations[:, 0] = rot.from_rotation_vector(turn)
    roots_m = np.column_stack((0.3 * np.sin(times_s), 0.9 + 0.03 * np.sin(8.0 * times_s), 1.2 * times_s))
    return rotations, roots_m


def hands_m(rotations: np.ndarray, roots_m: np.ndarray) -> np.ndarray:
    """Return positions (F, 3) of the left hand."""
    return forward_kinematics(SKELETON, rotations, roots_m)[0][:, HAND]


def hands_at(times_s: np.ndarray) -> np.ndarray:
    """Return the true positions (F, 3) of the left hand."""
    return hands_m(*poses_at(times_s))


def scene_poses(series: Series) -> list[ScenePose]:
    """Return the poses of a series, with all markers seen, and a prop in the hand."""
    rotations, roots_m = poses_at(series.true_s)
    hands, markers_m = hands_m(rotations, roots_m), markers_at(series.true_s)
    found = []
    for number, time_s in enumerate(series.written_s.tolist()):
        seen = markers_m[number]
        pose = performer_pose(number, rotations[number], roots_m[number], markers=len(seen))
        body = replace(pose, time_s=time_s, observed_m=seen, markers_m=seen)
        found.append(ScenePose((body,), (PropPose(rotations[number, 0], hands[number], 0.001, 4),)))
    return found


def markers_at(times_s: np.ndarray) -> np.ndarray:
    """Return the true positions (F, M, 3) of the markers."""
    joints = SUIT.joint_indices(SKELETON)
    return marker_positions(SKELETON, joints, SUIT.offsets_m, *poses_at(times_s))

"""A sword among a performer's markers as two cameras see it, made up without pictures."""

from dataclasses import replace

import numpy as np
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.prop import Prop
from perfanim.core.simulate.studio.carried_prop import HAND, in_hand
from perfanim.core.simulate.studio.studio_rig import default_rig

FPS = 60.0
PIXELS = 0.1  # standard deviation of the blobs' centres


def swung(frames, seed=0):
    """Poses (F, 4), (F, 3) of a prop that is waved before the cameras, its tip at up to 6 m/s."""
    generator = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / FPS
    rates, phases = generator.uniform(2.0, 5.0, (2, 3)), generator.uniform(0.0, 6.0, (2, 3))
    turns = rot.from_rotation_vector(np.array([0.6, 0.3, 0.9]) * np.sin(rates[0] * t + phases[0]))
    return turns, np.array([0.0, 1.2, 0.3]) + 0.15 * np.sin(rates[1] * t + phases[1])


def markers_of(prop: Prop, turns, places):
    """The prop's markers (F, M, 3)."""
    return places[:, None] + rot.rotate(turns[:, None], prop.positions_m)


def held_poses(prop: Prop, motion):
    """Quaternions (F, 4) and origins (F, 3), world from prop, of a prop in the hand along a motion."""
    carried, joint = in_hand(prop), motion.skeleton.index(HAND)
    places, turns = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    hand = turns[:, joint]
    return rot.multiply(hand, carried.rotation), places[:, joint] + rot.rotate(hand, carried.position_m)


class Film:
    """Makes marker frames of points as two cameras 3.3 m away see them, in an order that changes."""

    def __init__(self, record, seed=0):
        self.rig = default_rig()
        self._record = replace(record, rig=self.rig)
        self._generator = np.random.default_rng(seed)

    def __call__(self, points, number, hidden=(), images=True):
        """The frame of points (N, 3); `hidden` are (row, camera), with camera -1 for both."""
        unseen = {(row, c) for row, camera in hidden for c in ((0, 1) if camera < 0 else (camera,))}
        order = self._generator.permutation(len(points))
        place = {int(row): index for index, row in enumerate(order)}
        shuffled = points[order].copy()
        for row, index in place.items():
            if {(row, 0), (row, 1)} <= unseen:
                shuffled[index] = np.nan
        frame = self._record(
            shuffled, number, cameras=images, fps=FPS, hidden=tuple((place[row], c) for row, c in unseen)
        )
        blobs = [rows.copy() for rows in frame.blobs]
        for rows in blobs:
            rows[:, :2] += self._generator.normal(scale=PIXELS, size=(len(rows), 2))
        points_m = frame.points_m + self._generator.normal(scale=0.001, size=frame.points_m.shape)
        return replace(frame, points_m=points_m, blobs=tuple(blobs), detected=tuple(blobs))

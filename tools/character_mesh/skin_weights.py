"""Skin weights of a character, smooth across every joint, computed from rest positions.

Weight starts at the root and passes from bone to bone: across a plane through each joint, the parent's share goes to
the child, over a width that suits the joint. So weights are never negative, sum to one and change smoothly on a mesh
of any resolution. World space, metres; widths are for a body of 1.75 m.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .shapes import Figure
from .surface import Array


def skin_weights(figure: Figure, points: Array, part_names: NDArray[np.str_], thumb_share: Array) -> Array:
    """Return the weights (V, J) of points (V, 3) in the rest pose.

    Args:
        part_names: Name of the part to which each point belongs (V,).
        thumb_share: Share of each point that belongs to a thumb (V,): position alone cannot tell it from the palm.
    """
    weights = _Weights(figure, points)
    _spine(weights)
    _head(weights, part_names)
    for side, out in (("l", 1.0), ("r", -1.0)):
        _arm(weights, side, out)
        _hand(weights, side, thumb_share)
        _leg(weights, side, out)
    return weights.values


def eased(signed: Array) -> Array:
    """Return a smooth step from 0 at -1 to 1 at 1."""
    t = np.clip(0.5 + 0.5 * signed, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


class _Weights:
    """Shares (V, J) while they are passed on."""

    def __init__(self, figure: Figure, points: Array) -> None:
        self.skeleton, self.figure, self.points = figure.skeleton, figure, points
        self.values = np.zeros((len(points), len(self.skeleton)))
        self.values[:, 0] = 1.0

    def beyond(self, origin: ArrayLike, normal: ArrayLike, half_width: float) -> Array:
        """Return 0 to 1 (V,): distance beyond a plane, eased over twice the half width."""
        direction = np.asarray(normal, dtype=np.float64)
        distance = (self.points - np.asarray(origin)) @ (direction / np.linalg.norm(direction))
        return eased(distance / (self.figure.scale * half_width))

    def hand_on(self, givers: Sequence[str], taker: str, share: Array) -> None:
        """Pass a share (V,) of the givers' weights to the receiver."""
        for giver in givers:
            column = self.skeleton.index(giver)
            moved = share * self.values[:, column]
            self.values[:, column] -= moved
            self.values[:, self.skeleton.index(taker)] += moved


def _spine(w: _Weights) -> None:
    f, up = w.figure, (0.0, 1.0, 0.0)
    w.hand_on(["root"], "lowerback", w.beyond(f.off(f.joint("lowerback"), 0.0, 0.03, 0.0), up, 0.07))
    w.hand_on(["lowerback"], "upperback", w.beyond(f.joint("upperback"), up, 0.07))
    w.hand_on(["upperback"], "thorax", w.beyond(f.joint("thorax"), up, 0.07))
    neck = w.beyond(f.off(f.neck_base, 0.0, 0.045, -0.01), (0.0, 1.0, -0.25), 0.045)
    middle = 1.0 - eased((np.abs(w.points[:, 0]) - 0.085 * f.scale) / (0.03 * f.scale))
    w.hand_on(["thorax"], "lowerneck", neck * middle)


def _head(w: _Weights, part_names: NDArray[np.str_]) -> None:
    """Weight head and neck; hair and eyes turn only with the skull, the collar only with the neck."""
    f = w.figure
    skin = part_names == "head"
    neck = w.beyond(f.off(f.neck_base, 0.0, 0.045, -0.01), (0.0, 1.0, -0.25), 0.045)
    w.hand_on(["thorax", "upperback"], "lowerneck", skin * neck)
    middle = f.off(0.5 * (f.neck_base + f.joint("head")), 0.0, 0.015, 0.0)
    w.hand_on(["lowerneck"], "upperneck", skin * w.beyond(middle, (0.0, 1.0, 0.0), 0.04))
    # the chin hangs below the neck's end, so the plane between neck and skull leans forward
    skull = w.beyond(f.off(f.skull_base, 0.0, 0.012, 0.005), (0.0, 0.8, 0.6), 0.035)
    w.hand_on(["lowerneck", "upperneck"], "head", skin * skull)
    rigid = np.isin(part_names, ("hair", "eye")).astype(np.float64)
    w.hand_on([name for name in w.skeleton.names if name != "head"], "head", rigid)


def _arm(w: _Weights, side: str, out: float) -> None:
    f = w.figure
    shoulder, elbow, twist, wrist = (f.joint(side + n) for n in ("humerus", "radius", "wrist", "hand"))
    clavicle = w.beyond([0.52 * shoulder[0], 0.0, 0.0], (out, 0.0, 0.0), 0.065)
    upper = w.beyond(f.off(shoulder, 0.0, -0.055, 0.0), (0.25 * out, 1.0, 0.0), 0.060)
    w.hand_on(["thorax", "lowerneck"], side + "clavicle", clavicle * upper)
    deltoid = w.beyond(f.off(shoulder, -0.012 * out, 0.0, 0.0), (out, -0.10, 0.0), 0.085)
    # the ribs below the armpit stay with the chest, although they are as far out as the shoulder
    above_armpit = w.beyond(f.off(shoulder, 0.0, -0.072, 0.0), (0.0, 1.0, 0.0), 0.040)
    arm_only = w.beyond(f.off(shoulder, 0.050 * out, 0.0, 0.0), (out, 0.0, 0.0), 0.030)
    w.hand_on(
        ["thorax", "upperback", side + "clavicle"], side + "humerus", deltoid * np.maximum(above_armpit, arm_only)
    )
    w.hand_on([side + "humerus"], side + "radius", w.beyond(elbow, wrist - elbow, 0.050))
    # the forearm's twist is spread over most of its length
    centre = twist + 0.10 * (elbow - twist)
    w.hand_on([side + "radius"], side + "wrist", w.beyond(centre, wrist - elbow, 0.085))


def _hand(w: _Weights, side: str, thumb_share: Array) -> None:
    f = w.figure
    wrist, knuckles = f.joint(side + "hand"), f.joint(side + "fingers")
    along = knuckles - wrist
    beyond_wrist = w.beyond(wrist, along, 0.022)
    w.hand_on([side + "wrist"], side + "hand", beyond_wrist)
    w.hand_on([side + "hand"], side + "thumb", thumb_share)
    bend = wrist + 1.75 * along  # the product's fingers start short of the knuckles
    w.hand_on([side + "hand"], side + "fingers", w.beyond(bend, along, 0.022))


def _leg(w: _Weights, side: str, out: float) -> None:
    f = w.figure
    hip, knee, ankle, toes = (f.joint(side + n) for n in ("femur", "tibia", "foot", "toes"))
    own_side = eased(out * w.points[:, 0] / (0.022 * f.scale))
    # the crease of the groin runs from the crotch up to the side of the hip
    groin = w.beyond(f.off(hip, 0.0, -0.016, 0.0), (0.42 * out, -0.91, 0.0), 0.075)
    w.hand_on(["root", "lowerback"], side + "femur", groin * own_side)
    w.hand_on([side + "femur"], side + "tibia", w.beyond(knee, ankle - hip, 0.062))
    w.hand_on([side + "tibia"], side + "foot", w.beyond(f.off(ankle, 0.0, 0.035, 0.0), (0.0, -1.0, 0.25), 0.035))
    heading = np.array([toes[0] - ankle[0], 0.0, toes[2] - ankle[2]])
    w.hand_on([side + "foot"], side + "toes", w.beyond(toes, heading, 0.028))

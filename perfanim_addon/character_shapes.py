"""The shapes of a person around a skeleton in its T pose: shirt, trousers, shoes, head, hair, hands.

Girths follow the body's height, lengths the skeleton's bones. Product space, metres; the figures are for 1.75 m.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.product_skeleton import default_skeleton
from ..core.skeleton import Skeleton
from .character_surface import Array, Loft, ball


@dataclass(frozen=True)
class Part:
    """A closed surface of the body and how it is meshed.

    Args:
        name: "clothes", "head", "hair", "shoe", "hand", "eye".
        side: "l", "r" or "" for the middle.
        shapes: what it is made of.
        spacing_m: size of its quadrilaterals.
    """

    name: str
    side: str
    shapes: tuple[Loft, ...]
    spacing_m: float


class Figure:
    """Landmarks of a body: joints by name, and the scale of its girths.

    Args:
        skeleton: the product's joints.
        heads_m: (J, 3) joint positions of the rest pose, product space.
    """

    def __init__(self, skeleton: Skeleton, heads_m: NDArray[np.float64]) -> None:
        self._skeleton = skeleton
        self._heads = heads_m
        self.scale = _height(skeleton) / _height(default_skeleton())

    def joint(self, name: str) -> Array:
        """Return a joint's position (3,)."""
        found: Array = self._heads[self._skeleton.index(name)]
        return found

    def tip(self, name: str) -> Array:
        """Return the position (3,) of the end of a joint's bone."""
        found: Array = self.joint(name) + self._skeleton.tips_m[self._skeleton.index(name)]
        return found

    def sized(self, *lengths: float) -> tuple[float, ...]:
        """Return lengths of a body of 1.75 m in this body's size."""
        return tuple(self.scale * length for length in lengths)

    def off(self, point: ArrayLike, x: float, y: float, z: float) -> Array:
        """Return a point moved by a distance given for a body of 1.75 m."""
        return np.asarray(point, dtype=np.float64) + self.scale * np.array([x, y, z])


def _height(skeleton: Skeleton) -> float:
    """Return a length that grows with stature: legs and spine end to end."""
    spine = ("lowerback", "upperback", "thorax", "lowerneck", "upperneck")
    legs = [side + name for side in "lr" for name in ("femur", "tibia")]
    tips = np.linalg.norm(skeleton.tips_m, axis=1)
    return float(sum(tips[skeleton.index(n)] for n in spine) + 0.5 * sum(tips[skeleton.index(n)] for n in legs))


def parts_of(figure: Figure) -> list[Part]:
    """Return all parts of the body."""
    fine = figure.scale
    sides = ("l", "r")
    clothes = _torso(figure) + [shape for side in sides for shape in (*_leg(figure, side), *_arm(figure, side))]
    parts = [
        Part("clothes", "", tuple(clothes), 0.0245 * fine),
        Part("head", "", tuple(_head(figure)), 0.0135 * fine),
        Part("hair", "", tuple(_hair(figure)), 0.0160 * fine),
    ]
    for side in sides:
        parts.append(Part("shoe", side, tuple(_shoe(figure, side)), 0.0190 * fine))
        parts.append(Part("hand", side, tuple(_hand(figure, side)), 0.0088 * fine))
        parts.append(Part("eye", side, (_eye(figure, side),), 0.0060 * fine))
    return parts


def _torso(figure: Figure) -> list[Loft]:
    hips = 0.5 * (figure.joint("lfemur") + figure.joint("rfemur"))
    hips[2] = 0.5 * (hips[2] + figure.joint("root")[2])
    neck = figure.joint("lowerneck")
    f = figure
    trunk = Loft(
        hips, neck, (-0.07, 0.03, 0.20, 0.36, 0.50, 0.66, 0.80, 0.91, 1.00, 1.07),
        f.sized(0.118, 0.158, 0.157, 0.141, 0.143, 0.158, 0.163, 0.146, 0.100, 0.066),
        f.sized(0.088, 0.108, 0.105, 0.098, 0.101, 0.113, 0.112, 0.098, 0.078, 0.063),
        f.sized(-0.002, -0.006, -0.003, 0.004, 0.006, 0.004, -0.004, -0.012, -0.014, -0.010),
        across=(-1.0, 0.0, 0.0), caps=(0.055 * f.scale, 0.02 * f.scale), power=2.35,
    )  # fmt: skip
    shapes = [trunk]
    for side, out in (("l", 1.0), ("r", -1.0)):
        hip, shoulder = f.joint(side + "femur"), f.joint(side + "humerus")
        shapes.append(ball(f.off(hip, -0.012 * out, 0.000, -0.058), f.sized(0.080, 0.085, 0.072), blend=0.05))
        chest = np.array([0.40 * shoulder[0], neck[1], neck[2]])
        shapes.append(ball(f.off(chest, 0.0, -0.085, 0.062), f.sized(0.080, 0.062, 0.048), blend=0.06))
        inner = f.off(neck, 0.030 * out, 0.010, -0.022)
        shapes.append(Loft(inner, f.off(shoulder, -0.02 * out, 0.012, -0.006), (0.0, 1.0),
                           f.sized(0.046, 0.048), blend=0.06 * f.scale))  # fmt: skip
        blade = np.array([0.55 * shoulder[0], neck[1], neck[2]])
        shapes.append(ball(f.off(blade, 0.0, -0.075, -0.075), f.sized(0.075, 0.085, 0.040), blend=0.06))
    return shapes


def _leg(figure: Figure, side: str) -> list[Loft]:
    f = figure
    hip, knee, ankle = (f.joint(side + name) for name in ("femur", "tibia", "foot"))
    thigh = Loft(
        hip, knee, (-0.02, 0.12, 0.30, 0.55, 0.82, 1.00),
        f.sized(0.084, 0.090, 0.086, 0.073, 0.060, 0.056), f.sized(0.092, 0.096, 0.091, 0.078, 0.064, 0.060),
        f.sized(-0.014, -0.010, 0.000, 0.006, 0.004, 0.004), across=(1.0, 0.0, 0.0),
        caps=f.sized(0.05, 0.03), blend=0.045 * f.scale,
    )  # fmt: skip
    shank = Loft(
        knee, ankle, (0.00, 0.14, 0.32, 0.55, 0.80, 0.93),
        f.sized(0.055, 0.056, 0.058, 0.051, 0.044, 0.0465), f.sized(0.059, 0.061, 0.064, 0.055, 0.047, 0.050),
        f.sized(0.004, -0.004, -0.013, -0.009, -0.004, -0.003), across=(1.0, 0.0, 0.0),
        caps=f.sized(0.03, 0.012), blend=0.04 * f.scale, power=2.1,
    )  # fmt: skip
    return [thigh, shank]


def _arm(figure: Figure, side: str) -> list[Loft]:
    f = figure
    out = 1.0 if side == "l" else -1.0
    shoulder, elbow, wrist = (f.joint(side + name) for name in ("humerus", "radius", "hand"))
    upper = Loft(
        shoulder, elbow, (0.00, 0.14, 0.35, 0.60, 0.85, 1.00),
        f.sized(0.057, 0.056, 0.051, 0.048, 0.043, 0.042), f.sized(0.057, 0.057, 0.052, 0.047, 0.042, 0.041),
        f.sized(-0.004, -0.004, -0.003, 0.0, 0.0, 0.0), across=(0.0, 0.0, -out),
        caps=f.sized(0.035, 0.02), blend=0.05 * f.scale,
    )  # fmt: skip
    fore = Loft(
        elbow, wrist, (0.00, 0.16, 0.35, 0.62, 0.85, 0.95),
        f.sized(0.042, 0.045, 0.0445, 0.038, 0.0345, 0.0355), f.sized(0.041, 0.043, 0.042, 0.035, 0.0305, 0.0315),
        across=(0.0, 0.0, -out), caps=f.sized(0.02, 0.010), blend=0.03 * f.scale,
    )  # fmt: skip
    return [upper, fore]


def _head(figure: Figure) -> list[Loft]:
    f = figure
    base = f.joint("head")
    skull = Loft(
        base, f.off(base, 0.0, 0.20, 0.0),
        (-0.08, 0.00, 0.14, 0.30, 0.46, 0.64, 0.82, 0.95),
        f.sized(0.024, 0.043, 0.056, 0.065, 0.0715, 0.0765, 0.0720, 0.058),
        f.sized(0.024, 0.046, 0.067, 0.082, 0.090, 0.0960, 0.0910, 0.074),
        f.sized(0.070, 0.050, 0.030, 0.018, 0.010, 0.0040, -0.0020, -0.004),
        across=(-1.0, 0.0, 0.0), caps=f.sized(0.012, 0.032), power=2.15,
    )  # fmt: skip
    neck = Loft(
        f.off(f.joint("lowerneck"), 0.0, 0.0, -0.012), f.off(base, 0.0, 0.03, 0.0), (0.0, 0.35, 1.0),
        f.sized(0.072, 0.058, 0.055), f.sized(0.066, 0.059, 0.058), across=(-1.0, 0.0, 0.0), blend=0.025 * f.scale,
    )  # fmt: skip
    nose = Loft(
        f.off(base, 0.0, 0.102, 0.092), f.off(base, 0.0, 0.062, 0.110), (0.0, 1.0), f.sized(0.009, 0.014),
        f.sized(0.009, 0.012), across=(1.0, 0.0, 0.0), caps=f.sized(0.012, 0.008), blend=0.018 * f.scale,
    )  # fmt: skip
    brow = Loft(
        f.off(base, -0.045, 0.123, 0.074), f.off(base, 0.045, 0.123, 0.074), (0.0, 0.5, 1.0),
        f.sized(0.011, 0.018, 0.011), blend=0.02 * f.scale,
    )  # fmt: skip
    ears = [
        ball(f.off(base, out * 0.074, 0.083, -0.006), f.sized(0.011, 0.030, 0.019), blend=0.008 * f.scale)
        for out in (1.0, -1.0)
    ]
    return [skull, neck, brow, nose, *ears]


def _hair(figure: Figure) -> list[Loft]:
    f = figure
    base = f.joint("head")
    crown = ball(f.off(base, 0.0, 0.150, -0.012), f.sized(0.084, 0.082, 0.100))
    nape = ball(f.off(base, 0.0, 0.085, -0.052), f.sized(0.068, 0.070, 0.052), blend=0.05 * f.scale)
    fringe = Loft(
        f.off(base, -0.050, 0.178, 0.050), f.off(base, 0.050, 0.186, 0.054), (0.0, 0.5, 1.0),
        f.sized(0.024, 0.036, 0.026), blend=0.03 * f.scale,
    )  # fmt: skip
    return [crown, nape, fringe]


def _eye(figure: Figure, side: str) -> Loft:
    out = 1.0 if side == "l" else -1.0
    return ball(figure.off(figure.joint("head"), out * 0.031, 0.098, 0.0905), figure.sized(0.0095, 0.0115, 0.0075))


def _hand(figure: Figure, side: str) -> list[Loft]:
    f = figure
    wrist, knuckles, tip = f.joint(side + "hand"), f.joint(side + "fingers"), f.tip(side + "fingers")
    length = float(np.linalg.norm(tip - wrist)) / 0.105
    along = (tip - wrist) / np.linalg.norm(tip - wrist)
    across = np.cross([0.0, 1.0, 0.0], along) * (-1.0 if side == "l" else 1.0)
    across /= np.linalg.norm(across)
    forward = across if across[2] > 0.0 else -across
    up = np.array([0.0, f.scale, 0.0])

    def at(distance: float, aside: float, height: float = 0.0) -> Array:
        return wrist + length * distance * along + f.scale * aside * forward + height * up

    palm = Loft(
        at(-0.055, 0.0), at(0.088, 0.002), (0.0, 0.30, 0.50, 0.75, 0.97),
        f.sized(0.0240, 0.0245, 0.0300, 0.0390, 0.0400), f.sized(0.0190, 0.0185, 0.0180, 0.0170, 0.0135),
        across=forward, caps=f.sized(0.01, 0.008), power=2.5,
    )  # fmt: skip
    fingers = [
        Loft(at(0.075, 0.75 * aside), at(reach, aside, -0.006), (0.0, 0.55, 1.0), f.sized(0.0100, 0.0092, 0.0078),
             caps=f.sized(0.008, 0.009), blend=0.007 * f.scale)
        for aside, reach in ((0.0360, 0.155), (0.0125, 0.168), (-0.0110, 0.160), (-0.0335, 0.137))
    ]  # fmt: skip
    root, end = at(0.012, 0.016, -0.004), f.tip(side + "thumb")
    end = root + (end - root) * (f.scale * 0.088 / np.linalg.norm(end - root))
    thumb = Loft(root, end, (0.0, 0.5, 1.0), f.sized(0.0165, 0.0140, 0.0095),
                 caps=f.sized(0.01, 0.010), blend=0.016 * f.scale)  # fmt: skip
    return [palm, *fingers, thumb]


def _shoe(figure: Figure, side: str) -> list[Loft]:
    f = figure
    ankle, ball_of_foot, tip = f.joint(side + "foot"), f.joint(side + "toes"), f.tip(side + "toes")
    floor = min(ball_of_foot[1], tip[1]) - 0.024 * f.scale
    heading = tip - ankle
    heading[1] = 0.0
    length = float(np.linalg.norm(heading))
    heading /= length
    start = np.array([ankle[0], floor, ankle[2]])
    across = np.cross([0.0, 1.0, 0.0], heading)
    heights = f.sized(0.030, 0.036, 0.040, 0.036, 0.027, 0.021, 0.018)
    sole = Loft(
        start, start + length * heading, (-0.18, -0.02, 0.22, 0.45, 0.66, 0.85, 1.00),
        f.sized(0.029, 0.034, 0.034, 0.038, 0.045, 0.042, 0.030), heights, heights,
        across=across, caps=f.sized(0.026, 0.022), power=2.7,
    )  # fmt: skip
    collar = Loft(
        f.off(ankle, 0.0, -0.030, -0.004), ankle + 0.20 * (f.joint(side + "tibia") - ankle), (0.0, 0.6, 1.0),
        f.sized(0.036, 0.036, 0.037), f.sized(0.043, 0.040, 0.038), across=(-1.0, 0.0, 0.0), blend=0.03 * f.scale,
    )  # fmt: skip
    return [sole, collar]

"""Shapes of a person around a skeleton in T pose.

Girths follow the body's height, lengths the skeleton's bones. World space, metres; the numbers are for 1.75 m.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from perfanim.core.body.body_size import SOLE_BELOW_TOES_M, girth_scale
from perfanim.core.body.skeleton import Skeleton

from .surface import Array, Loft, ball


@dataclass(frozen=True)
class Part:
    """A closed surface of the body: "clothes", "head", "hair", "shoe", "hand", "eye"."""

    name: str
    shapes: list[Loft]  # the surface is their union
    spacing_m: float  # size of its quadrilaterals


class Figure:
    """Landmarks of a body: joints by name, and the scale of its girths.

    Args:
        heads_m: Joint positions of the rest pose (J, 3), world space.
    """

    def __init__(self, skeleton: Skeleton, heads_m: Array) -> None:
        self.skeleton, self._heads = skeleton, heads_m
        self.scale = girth_scale(skeleton)

    def joint(self, name: str) -> Array:
        """Return a joint's position (3,)."""
        return np.asarray(self._heads[self.skeleton.index(name)])

    def tip(self, name: str) -> Array:
        """Return the position (3,) of the end of a joint's bone."""
        return self.joint(name) + self.skeleton.tips_m[self.skeleton.index(name)]

    @property
    def neck_base(self) -> Array:
        """Point (3,) where the neck leaves the trunk; some skeletons have their lowest neck joint higher up."""
        neck = self.joint("lowerneck").copy()
        shoulders = 0.5 * (self.joint("lhumerus")[1] + self.joint("rhumerus")[1])
        neck[1] = min(neck[1], shoulders - 0.045 * self.scale)
        return neck

    @property
    def skull_base(self) -> Array:
        """Point (3,) at chin height relative to which the head's shapes are defined."""
        return self.off(self.joint("head"), 0.0, -0.012, 0.0)

    def sized(self, *lengths: float) -> tuple[float, ...]:
        """Return lengths, given for a body of 1.75 m, scaled to this body."""
        return tuple(self.scale * length for length in lengths)

    def off(self, point: ArrayLike, x: float, y: float, z: float) -> Array:
        """Return a point moved by a distance given for a body of 1.75 m."""
        return np.asarray(point, dtype=np.float64) + self.scale * np.array([x, y, z])


def parts_of(figure: Figure) -> list[Part]:
    """Return all parts of the body."""
    clothes = _torso(figure) + [shape for side in "lr" for shape in (*_leg(figure, side), *_arm(figure, side))]
    spacings = {"shoe": (_shoe, 0.0240), "hand": (_hand, 0.0110), "eye": (_eye, 0.0075)}
    return [
        Part("clothes", clothes, 0.0325 * figure.scale),
        Part("head", _head(figure), 0.0195 * figure.scale),
        Part("hair", _hair(figure), 0.0250 * figure.scale),
        *(
            Part(name, shapes(figure, side), spacing * figure.scale)
            for side in "lr"
            for name, (shapes, spacing) in spacings.items()
        ),
    ]


def _torso(f: Figure) -> list[Loft]:
    hips = 0.5 * (f.joint("lfemur") + f.joint("rfemur"))
    hips[2] = 0.5 * (hips[2] + f.joint("root")[2])
    neck = f.neck_base
    trunk = Loft(
        hips, neck, (-0.07, 0.03, 0.20, 0.36, 0.50, 0.66, 0.80, 0.92, 1.02),
        f.sized(0.118, 0.158, 0.157, 0.144, 0.145, 0.156, 0.160, 0.148, 0.110),
        f.sized(0.088, 0.108, 0.105, 0.100, 0.102, 0.112, 0.112, 0.100, 0.080),
        f.sized(-0.002, -0.006, -0.003, 0.004, 0.006, 0.004, -0.004, -0.012, -0.014),
        across=(-1.0, 0.0, 0.0), caps=f.sized(0.055, 0.030), power=2.35,
    )  # fmt: skip
    collar = Loft(
        f.off(neck, 0.0, -0.06, -0.016), f.off(neck, 0.0, 0.062, -0.008), (0.0, 0.5, 1.0),
        f.sized(0.105, 0.084, 0.067), f.sized(0.080, 0.074, 0.066), across=(-1.0, 0.0, 0.0),
        caps=f.sized(0.02, 0.008), blend=0.04 * f.scale,
    )  # fmt: skip
    return [trunk, collar, *_flank(f, "l", 1.0), *_flank(f, "r", -1.0)]


def _flank(f: Figure, side: str, out: float) -> list[Loft]:
    """Return the shapes of one side of the trunk, from buttock to shoulder."""
    hip, shoulder, neck = f.joint(side + "femur"), f.joint(side + "humerus"), f.neck_base
    chest = np.array([0.40 * shoulder[0], neck[1], neck[2]])
    blade = np.array([0.55 * shoulder[0], neck[1], neck[2]])
    acromion = f.off(shoulder, -0.026 * out, -0.009, -0.004)
    wide = 0.06 * f.scale
    return [
        ball(f.off(hip, -0.012 * out, 0.0, -0.058), f.sized(0.080, 0.085, 0.072), blend=wide),
        ball(f.off(chest, 0.0, -0.080, 0.056), f.sized(0.078, 0.060, 0.046), blend=wide),
        ball(f.off(blade, 0.0, -0.070, -0.070), f.sized(0.075, 0.085, 0.040), blend=wide),
        Loft(f.off(neck, 0.034 * out, 0.068, -0.026), f.off(acromion, 0.0, 0.000, -0.008), (0.0, 0.5, 1.0),
             f.sized(0.036, 0.039, 0.038), caps=f.sized(0.03, 0.03), blend=wide),
        Loft(f.off(neck, 0.04 * out, -0.015, -0.010), acromion, (0.0, 1.0), f.sized(0.050, 0.045),
             caps=f.sized(0.03, 0.03), blend=wide),
    ]  # fmt: skip


def _leg(f: Figure, side: str) -> list[Loft]:
    hip, knee, ankle = (f.joint(side + name) for name in ("femur", "tibia", "foot"))
    thigh = Loft(
        hip, knee, (-0.02, 0.12, 0.30, 0.55, 0.82, 1.00),
        f.sized(0.084, 0.090, 0.086, 0.073, 0.060, 0.056), f.sized(0.092, 0.096, 0.091, 0.078, 0.064, 0.060),
        f.sized(-0.014, -0.010, 0.000, 0.006, 0.004, 0.004), across=(1.0, 0.0, 0.0),
        caps=f.sized(0.05, 0.05), blend=0.045 * f.scale,
    )  # fmt: skip
    shank = Loft(
        knee, ankle, (0.00, 0.14, 0.32, 0.55, 0.80, 0.93),
        f.sized(0.054, 0.055, 0.058, 0.051, 0.042, 0.0360), f.sized(0.058, 0.060, 0.064, 0.055, 0.045, 0.0390),
        f.sized(0.004, -0.004, -0.013, -0.009, -0.004, -0.003), across=(1.0, 0.0, 0.0),
        caps=f.sized(0.05, 0.012), blend=0.006 * f.scale, power=2.1,
    )  # fmt: skip
    return [thigh, shank]


def _arm(f: Figure, side: str) -> list[Loft]:
    out = 1.0 if side == "l" else -1.0
    shoulder, elbow, wrist = (f.joint(side + name) for name in ("humerus", "radius", "hand"))
    upper = Loft(
        shoulder, elbow, (0.00, 0.14, 0.35, 0.60, 0.85, 1.00),
        f.sized(0.056, 0.056, 0.052, 0.048, 0.043, 0.042), f.sized(0.054, 0.054, 0.051, 0.047, 0.042, 0.041),
        f.sized(-0.013, -0.010, -0.004, 0.0, 0.0, 0.0), across=(0.0, 0.0, -out),
        caps=f.sized(0.05, 0.04), blend=0.055 * f.scale,
    )  # fmt: skip
    fore = Loft(
        elbow, wrist, (0.00, 0.16, 0.35, 0.62, 0.85, 0.95),
        f.sized(0.042, 0.045, 0.0445, 0.038, 0.0345, 0.0355), f.sized(0.041, 0.043, 0.042, 0.035, 0.0305, 0.0315),
        across=(0.0, 0.0, -out), caps=f.sized(0.04, 0.010), blend=0.006 * f.scale,
    )  # fmt: skip
    return [upper, fore]


def _skull(f: Figure) -> tuple[Array, float]:
    """Return the head's reference point and scale (slightly larger than life)."""
    return f.skull_base, 1.10 * f.scale


def _head(f: Figure) -> list[Loft]:
    base, size = _skull(f)

    def at(x: float, y: float, z: float) -> Array:
        return base + size * np.array([x, y, z])

    def sized(*lengths: float) -> tuple[float, ...]:
        return tuple(size * length for length in lengths)

    skull = Loft(
        base, at(0.0, 0.20, 0.0), (-0.06, 0.00, 0.14, 0.30, 0.46, 0.64, 0.82, 0.95),
        sized(0.030, 0.045, 0.057, 0.065, 0.0715, 0.0765, 0.0720, 0.058),
        sized(0.028, 0.048, 0.067, 0.082, 0.090, 0.0960, 0.0910, 0.074),
        sized(0.062, 0.046, 0.030, 0.018, 0.010, 0.0040, -0.0020, -0.004),
        across=(-1.0, 0.0, 0.0), caps=sized(0.014, 0.032), power=2.15,
    )  # fmt: skip
    neck = Loft(
        f.off(f.neck_base, 0.0, 0.0, -0.012), at(0.0, 0.03, -0.008), (0.0, 0.35, 1.0),
        f.sized(0.066, 0.056, 0.054), f.sized(0.062, 0.057, 0.056), across=(-1.0, 0.0, 0.0), blend=0.020 * f.scale,
    )  # fmt: skip
    nose = Loft(
        at(0.0, 0.094, 0.090), at(0.0, 0.060, 0.103), (0.0, 1.0), sized(0.008, 0.0135), sized(0.008, 0.011),
        across=(1.0, 0.0, 0.0), caps=sized(0.012, 0.007), blend=0.016 * size,
    )  # fmt: skip
    brow = Loft(
        at(-0.045, 0.116, 0.073), at(0.045, 0.116, 0.073), (0.0, 0.5, 1.0), sized(0.011, 0.018, 0.011),
        blend=0.02 * size,
    )  # fmt: skip
    ears = [ball(at(out * 0.075, 0.078, 0.004), sized(0.012, 0.030, 0.020), blend=0.010 * size) for out in (1.0, -1.0)]
    return [skull, neck, brow, nose, *ears]


def _hair(figure: Figure) -> list[Loft]:
    base, size = _skull(figure)
    crown = ball(base + size * np.array([0.0, 0.150, -0.012]), [size * r for r in (0.089, 0.084, 0.101)])
    nape = ball(
        base + size * np.array([0.0, 0.085, -0.056]), [size * r for r in (0.074, 0.072, 0.054)], blend=0.05 * size
    )
    fringe = Loft(
        base + size * np.array([-0.050, 0.172, 0.050]), base + size * np.array([0.050, 0.180, 0.054]),
        (0.0, 0.5, 1.0), [size * r for r in (0.024, 0.036, 0.026)], blend=0.03 * size,
    )  # fmt: skip
    return [crown, nape, fringe]


def _eye(figure: Figure, side: str) -> list[Loft]:
    base, size = _skull(figure)
    out = 1.0 if side == "l" else -1.0
    return [ball(base + size * np.array([out * 0.031, 0.091, 0.0885]), [size * r for r in (0.0100, 0.0125, 0.0080)])]


def _hand(f: Figure, side: str) -> list[Loft]:
    wrist, tip = f.joint(side + "hand"), f.tip(side + "fingers")
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


def _shoe(f: Figure, side: str) -> list[Loft]:
    ankle, ball_of_foot, tip = f.joint(side + "foot"), f.joint(side + "toes"), f.tip(side + "toes")
    floor = min(ball_of_foot[1], tip[1]) - SOLE_BELOW_TOES_M * f.scale
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
        f.off(ankle, 0.0, -0.030, -0.004), f.off(ankle, 0.0, 0.052, -0.004), (0.0, 0.6, 1.0),
        f.sized(0.038, 0.046, 0.048), f.sized(0.045, 0.050, 0.051), across=(-1.0, 0.0, 0.0), blend=0.03 * f.scale,
    )  # fmt: skip
    return [sole, collar]

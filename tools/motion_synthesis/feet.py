"""Positions of the feet: contacts that stay in place, and swings between them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from perfanim.core.geometry import rotations as rot

from .curves import Array, ease
from .proportions import Sole, about

HELD_S = 0.35  # time for raising and lowering a foot that is held up
_UPRIGHT = (0.05, 0.97)  # part of a swing in which the foot travels: it moves straight up and down at its ends
_CORNER_RAD = 0.12  # smoothing of the change of pivot from ball to heel in the air


class Placement(NamedTuple):
    """A flat foot on the ground: x and z of its ball in metres, and its yaw, radians."""

    x_m: float
    z_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Swing:
    """A foot's path through the air to its next placement."""

    lift_s: float  # last time of contact
    land_s: float  # first time of the next contact
    to: Placement
    height_m: float  # largest height of the foot's ball above its height on the ground
    peak: float = 0.5  # fraction of the swing at which the height is largest
    power: float = 3.0  # exponent of the height's rise from the ground: 3 lifts gently, 1.5 as in a jump
    held: bool = False  # held up between raising and lowering for `HELD_S`

    def lift_m(self, times_s: Array) -> Array:
        """Return the ball's rise above the ground at times within the swing."""
        if self.held:
            up = ease((times_s - self.lift_s) / HELD_S) * ease((self.land_s - times_s) / HELD_S)
            return np.asarray(self.height_m * up)
        u = (times_s - self.lift_s) / (self.land_s - self.lift_s)
        before = self.power * max(1.0, self.peak / (1.0 - self.peak))
        after = before * (1.0 - self.peak) / self.peak
        top = self.peak**before * (1.0 - self.peak) ** after
        return np.asarray(self.height_m * (u**before * (1.0 - u) ** after / top))


@dataclass
class FootPath:
    """All placements and swings of one foot, in order of time."""

    first: Placement
    swings: list[Swing] = field(default_factory=list)

    @property
    def current(self) -> Placement:
        """Placement of the foot after the last swing so far."""
        return self.swings[-1].to if self.swings else self.first

    @property
    def free_s(self) -> float:
        """Time of the last landing so far (the foot cannot lift earlier)."""
        return self.swings[-1].land_s if self.swings else -np.inf

    def sample(self, times_s: Array) -> "FootSamples":
        """Return where the foot is at the given times."""
        start = np.array(self.first)
        ground = np.tile(start, (len(times_s), 1))
        lift, phase = np.zeros(len(times_s)), np.full(len(times_s), -1.0)
        for swing in self.swings:
            end = np.array(swing.to)
            u = (times_s - swing.lift_s) / (swing.land_s - swing.lift_s)
            gone = ease((u[u > 0.0, None] - _UPRIGHT[0]) / (_UPRIGHT[1] - _UPRIGHT[0]))
            ground[u > 0.0] = start + (end - start) * gone
            air = (u > 0.0) & (u < 1.0)
            lift[air], phase[air] = swing.lift_m(times_s[air]), u[air]
            start = end
        return FootSamples(ground, lift, phase)

    def contact_weight(self, times_s: Array, ramp_s: float) -> Array:
        """Return 0 in the air and 1 in contact, with ramps of `ramp_s` inside contacts."""
        weight = np.ones(len(times_s))
        for swing in self.swings:
            off, on = ease((swing.lift_s - times_s) / ramp_s), ease((times_s - swing.land_s) / ramp_s)
            weight = np.minimum(weight, np.maximum(off, on))
        return weight


@dataclass(frozen=True)
class FootSamples:
    """A foot over time: ground (T, 3) x, z, yaw; lift_m (T,); swing_phase (T,) or -1."""

    ground: Array
    lift_m: Array
    swing_phase: Array

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """Mask (T,) of the times at which the foot is planted."""
        return self.swing_phase < 0.0


def foot_pose(samples: FootSamples, sole: Sole, pitch_rad: Array) -> tuple[Array, Array]:
    """Return ankle positions (T, 3) and world-from-foot orientations (T, 4).

    A raised heel (positive pitch) turns the foot about its ball, raised toes (negative) about its heel, so the part
    that carries the weight does not slide; in the air, one pivot changes smoothly into the other.
    """
    inside = np.clip(samples.swing_phase, 0.0, 1.0)
    rounding = np.maximum(_CORNER_RAD * (4.0 * inside * (1.0 - inside)) ** 2, 1e-4)
    toes_up = about("X", -rounding * np.logaddexp(0.0, -pitch_rad / rounding))  # max(-pitch, 0) with a rounded corner
    tilt, yaw = about("X", pitch_rad), about("Y", samples.ground[:, 2])
    by_heel = sole.heel_m - rot.rotate(toes_up, sole.heel_m)
    ball = np.stack((samples.ground[:, 0], sole.ball_height_m + samples.lift_m, samples.ground[:, 1]), axis=1)
    ankle = ball + rot.rotate(yaw, by_heel + rot.rotate(tilt, sole.ankle_m))
    return ankle, rot.multiply(rot.multiply(yaw, tilt), sole.flat)


def toe_bend(samples: FootSamples, sole: Sole, pitch_rad: Array) -> Array:
    """Return the toes' rotation about x (negative is up): flat under a raised heel.

    In the air they relax until shortly before the landing, but never point below the ground.
    """
    raised = np.maximum(pitch_rad, 0.0)
    ready = 1.0 - ease(samples.swing_phase / 0.45) + ease((samples.swing_phase - 0.7) / 0.3)
    held = np.where(samples.in_contact, 1.0, ready)
    room = sole.ball_height_m * 0.8 + samples.lift_m
    clear = raised - np.arcsin(np.clip(room / sole.toe_m, 0.0, 1.0))
    return -np.maximum(raised * held, np.maximum(clear, 0.0))

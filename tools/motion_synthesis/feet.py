"""Where the feet are: contacts that stay put, and swings between them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from perfanim.core.geometry import rotations as rot

from .curves import Array, ease
from .proportions import Sole, about

HELD_S = 0.35
_UPRIGHT = (0.05, 0.97)  # share of a swing between which the foot travels: it goes straight up and down at its ends
_CORNER_RAD = 0.12  # rounding of the change of pivot from ball to heel in the air


@dataclass(frozen=True)
class Placement:
    """A flat foot on the ground: x, z of its ball in metres, and its yaw, radians."""

    x_m: float
    z_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Swing:
    """A foot's way through the air to its next placement.

    Args:
        lift_s, land_s: last and first time of contact.
        to: where it lands.
        height_m: greatest height of the foot's ball above its height on the ground, at `peak` of the swing.
        peak: share of the swing at which the height is greatest.
        power: of the height's rise from the ground: 3 lifts gently, 1.5 as in a jump.
        held: the height is kept up between a rise and a fall of `HELD_S`.
    """

    lift_s: float
    land_s: float
    to: Placement
    height_m: float
    peak: float = 0.5
    power: float = 3.0
    held: bool = False

    def lift_m(self, times_s: Array) -> Array:
        """Return the ball's rise above the ground at times within the swing."""
        if self.held:
            up = ease((times_s - self.lift_s) / HELD_S) * ease((self.land_s - times_s) / HELD_S)
            return np.asarray(self.height_m * up)
        u = (times_s - self.lift_s) / (self.land_s - self.lift_s)
        return np.asarray(self.height_m * _hump(u, self.peak, self.power))


@dataclass
class FootPath:
    """All placements and swings of one foot, in the order of time."""

    first: Placement
    swings: list[Swing] = field(default_factory=list)

    @property
    def current(self) -> Placement:
        """Where the foot stands after the last swing so far."""
        return self.swings[-1].to if self.swings else self.first

    @property
    def free_s(self) -> float:
        """Time of the last landing so far (a foot cannot lift before)."""
        return self.swings[-1].land_s if self.swings else -np.inf

    def sample(self, times_s: Array) -> "FootSamples":
        """Return where the foot is at the times."""
        count = len(times_s)
        ground = np.tile([self.first.x_m, self.first.z_m, self.first.yaw_rad], (count, 1))
        lift, phase = np.zeros(count), np.full(count, -1.0)
        start = ground[0].copy() if count else np.zeros(3)
        for swing in self.swings:
            end = np.array([swing.to.x_m, swing.to.z_m, swing.to.yaw_rad])
            u = (times_s - swing.lift_s) / (swing.land_s - swing.lift_s)
            ground[u > 0.0] = (
                start + (end - start) * ease((u - _UPRIGHT[0]) / (_UPRIGHT[1] - _UPRIGHT[0]))[u > 0.0, None]
            )
            air = (u > 0.0) & (u < 1.0)
            lift[air] = swing.lift_m(times_s[air])
            phase[air] = u[air]
            start = end
        return FootSamples(ground, lift, phase)

    def contact_weight(self, times_s: Array, ramp_s: float) -> Array:
        """Return 0 in the air and 1 in contact, with ramps of `ramp_s` inside contacts."""
        weight = np.ones(len(times_s))
        for swing in self.swings:
            off = ease((swing.lift_s - times_s) / ramp_s)
            on = ease((times_s - swing.land_s) / ramp_s)
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
        """(T,) true while the foot stands."""
        return self.swing_phase < 0.0


def _hump(u: Array, peak: float, power: float) -> Array:
    """Return a smooth bump over u in 0..1, 1 at `peak`, with ends at least of `power`."""
    before = power * max(1.0, peak / (1.0 - peak))
    after = before * (1.0 - peak) / peak
    top = peak**before * (1.0 - peak) ** after
    return np.asarray(u**before * (1.0 - u) ** after / top)


def foot_pose(samples: FootSamples, sole: Sole, pitch_rad: Array, roll_rad: Array) -> tuple[Array, Array]:
    """Return ankle positions (T, 3) and world-from-foot orientations (T, 4).

    A raised heel (positive pitch) turns the foot about its ball, raised toes (negative) about its heel, so the part
    that carries does not slide; in the air the one passes smoothly into the other.
    """
    tilt = rot.multiply(about("X", pitch_rad), about("Z", roll_rad))
    toes_up = about("X", -_toes_up(samples, pitch_rad))
    by_heel = sole.heel_m - rot.rotate(toes_up, sole.heel_m)
    ball = np.stack((samples.ground[:, 0], sole.ball_height_m + samples.lift_m, samples.ground[:, 1]), axis=1)
    yaw = about("Y", samples.ground[:, 2])
    ankle = ball + rot.rotate(yaw, by_heel + rot.rotate(tilt, sole.ankle_m))
    return ankle, rot.multiply(rot.multiply(yaw, tilt), sole.flat)


def _toes_up(samples: FootSamples, pitch_rad: Array) -> Array:
    """Return max(-pitch, 0), its corner rounded in the middle of a swing."""
    inside = np.clip(samples.swing_phase, 0.0, 1.0)
    rounding = np.maximum(_CORNER_RAD * (4.0 * inside * (1.0 - inside)) ** 2, 1e-4)
    return np.asarray(rounding * np.logaddexp(0.0, -pitch_rad / rounding))


def toe_bend(samples: FootSamples, sole: Sole, pitch_rad: Array, extra_rad: Array) -> Array:
    """Return the toes' rotation about x (negative is up): flat under a raised heel.

    In the air they relax until shortly before the landing, but never point below the ground.
    """
    raised = np.maximum(pitch_rad, 0.0)
    ready = 1.0 - ease(samples.swing_phase / 0.45) + ease((samples.swing_phase - 0.7) / 0.3)
    held = np.where(samples.in_contact, 1.0, ready)
    room = sole.ball_height_m * 0.8 + samples.lift_m
    clear = raised - np.arcsin(np.clip(room / sole.toe_m, 0.0, 1.0))
    bend = np.maximum(raised * held, np.maximum(clear, 0.0))
    return np.asarray(-bend + extra_rad)

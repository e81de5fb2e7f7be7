"""Timeline of a performance: keys of all controls, and the feet's steps.

Behaviours append to it; `synthesise_motion` turns it into joint rotations. As every behaviour starts from the
timeline's end, transitions need no blending of poses.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .arm_rotations import frame_from, unit
from .curves import Array, Track
from .feet import FootPath, Placement, Swing
from .proportions import SIDES, Body, outward, turned
from .style import Style

# Controls of the whole body: their sizes and values at ease; angles in radians, lengths in metres.
#   heading        direction that the body faces (0 is +z, towards the cameras)
#   height         of the root above the ground
#   offset         of the root from its balanced place over the feet: left, forward
#   weight         -1 all on the right foot .. 1 all on the left, where both stand
#   pelvis         yaw left, pitch forward, roll to the left against the heading
#   spine          bend forward, bend to the left, twist to the left, of the chest against the pelvis
#   head           yaw left, pitch down, roll against the heading
#   sword          left fist from the middle between the shoulders, in the heading's frame, over the arm's length
#   aim            of the blade: up from level, to the left; the edge's turn about the blade from looking down
#   holds          1 both hands are led by the sword, 0 each by its own target (changes only while `guide` is 0)
_BODY_CONTROLS: dict[str, tuple[float, ...]] = {
    "heading": (0.0,),
    "height": (0.0,),
    "offset": (0.0, 0.0),
    "weight": (0.0,),
    "pelvis": (0.0, 0.0, 0.0),
    "spine": (0.0, 0.0, 0.0),
    "head": (0.0, 0.0, 0.0),
    "sword": (0.0, -0.66, 0.42),
    "aim": (0.45, 0.0, 0.0),
    "holds": (0.0,),
}

# Controls of one side.
#   arm            shoulder: swing forward, sideways, twist inwards (see limbs.hanging_arm)
#   elbow          flexion
#   hand           forearm pronation, wrist flexion, bend to the little finger
#   grip           0 open, 1 fist
#   shrug          collar bone up, forward, beyond what the arm's direction brings along
#   guide          0 arm by angles, 1 hand led to `target` and `palm`
#   target         wrist from the middle between the shoulders, in the heading's frame
#   palm           heading-from-hand quaternion
#   swivel         elbow out from pointing down
#   pitch, roll, pivot  foot: heel up, inward tilt, turn about the ball
#   toes           toes up
#   lift           of a foot in the air, added to its swing's height
#   knee           knee outwards
_SIDE_CONTROLS: dict[str, tuple[float, ...]] = {
    "arm": (0.05, 0.11, -0.15),
    "elbow": (0.28,),
    "hand": (0.05, 0.12, 0.0),
    "grip": (0.25,),
    "shrug": (0.0, 0.0),
    "guide": (0.0,),
    "target": (0.0, -0.3, 0.2),
    "palm": (1.0, 0.0, 0.0, 0.0),
    "swivel": (0.3,),
    "pitch": (0.0,),
    "roll": (0.0,),
    "pivot": (0.0,),
    "toes": (0.0,),
    "lift": (0.0,),
    "knee": (0.0,),
}

STANDING_HEIGHT = 0.997  # root height of somebody at ease, share of that on straight legs


@dataclass
class Timeline:
    """Keys and steps of one performance of one body in one style."""

    body: Body
    style: Style
    rng: np.random.Generator
    tracks: dict[str, Track] = field(default_factory=dict)
    feet: dict[str, FootPath] = field(default_factory=dict)
    time_s: float = 0.0
    natural_from_s: float = -1e9  # from here on the performer's own carriage shows; before it poses exactly as keyed

    def __post_init__(self) -> None:
        for name, value in _BODY_CONTROLS.items():
            self.tracks[name] = Track()
            self.tracks[name].key(0.0, value)
        for side in SIDES:
            for name, value in _SIDE_CONTROLS.items():
                self.tracks[f"{side}.{name}"] = Track()
                self.tracks[f"{side}.{name}"].key(0.0, value)
            self.feet[side] = FootPath(self.placement(side, 0.0, 0.0, 0.0))
        self.set(0.0, height=self.body.standing_m * STANDING_HEIGHT, **self.at_ease())

    # ---- keys

    def set(self, time_s: float, **values: ArrayLike) -> None:
        """Set keys at a time; names of one side are written `l_arm` for "l.arm"."""
        for name, value in values.items():
            self.tracks[_track_name(name)].key(time_s, value)

    def move(self, name: str, time_s: float, value: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> None:
        """Set a key with given velocity and acceleration."""
        self.tracks[_track_name(name)].key(time_s, value, velocity, acceleration)

    def anchor(self, time_s: float, *names: str) -> None:
        """Hold the last values of controls (all without names) up to `time_s`.

        So later keys start from there.
        """
        for name in [_track_name(n) for n in names] or list(self.tracks):
            last = self.tracks[name].last()
            if last.time_s < time_s - 1e-3:
                self.tracks[name].key(time_s, last.value)

    def value(self, name: str) -> Array:
        """Return the last value of a control."""
        return self.tracks[_track_name(name)].last().value

    def hand(self, side: str, time_s: float, target: ArrayLike, fingers: ArrayLike, palm: ArrayLike) -> None:
        """Key a led hand's position (see `target`) and directions of fingers and palm."""
        along = unit(np.asarray(fingers, dtype=np.float64))
        facing = np.asarray(palm, dtype=np.float64)
        facing = unit(facing - (facing @ along) * along)
        rest = np.array([outward(side), 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
        turn = frame_from(*rest, along[None], facing[None])[0]
        before = self.value(f"{side}.palm")
        self.set(time_s, **{f"{side}.target": target, f"{side}.palm": turn if turn @ before >= 0.0 else -turn})

    def at_ease(self) -> dict[str, ArrayLike]:
        """Return the controls' values for standing with hanging arms, in this style."""
        style = self.style
        values: dict[str, ArrayLike] = {
            "offset": (0.0, 0.0),
            "weight": 0.0,
            "pelvis": (0.0, 0.03 + 0.1 * style.slouch_rad, 0.0),
            "spine": (0.02 + style.slouch_rad, 0.0, 0.0),
            "head": (0.0, 0.05 + style.head_drop_rad, 0.0),
        }
        for side in SIDES:
            lean = 0.5 * style.asymmetry * outward(side)
            values |= {
                f"{side}.arm": (0.04 + lean, 0.11, -0.15),
                f"{side}.elbow": max(0.12, 0.26 + style.elbows_rad + lean),
                f"{side}.hand": (0.05, 0.12, 0.0),
                f"{side}.grip": 0.25,
                f"{side}.shrug": (0.0, 0.0),
                f"{side}.guide": 0.0,
                f"{side}.pitch": 0.0,
                f"{side}.roll": 0.0,
                f"{side}.pivot": 0.0,
                f"{side}.toes": 0.0,
                f"{side}.lift": 0.0,
                f"{side}.knee": 0.3 * style.toe_out_rad,
            }
        return values

    # ---- feet

    def placement(self, side: str, x_m: float, z_m: float, heading_rad: float, width: float = 1.0) -> Placement:
        """Return where a foot stands under a body at (x, z) that faces `heading_rad`.

        (x, z) is the ground point under the middle between the ankles.
        """
        aside = outward(side) * self.body.stance_m * width * self.style.width
        toe_out = outward(side) * self.style.toe_out_rad
        return self.placed(side, (x_m, z_m), heading_rad, aside, 0.0, toe_out)

    def placed(
        self, side: str, spot: tuple[float, float], heading_rad: float, left_m: float, forward_m: float, yaw_rad: float
    ) -> Placement:
        """Return the placement for an ankle `left_m` and `forward_m` of a spot."""
        yaw = heading_rad + yaw_rad
        ahead = -float(self.body.sole(side).ankle_m[2])
        dx, dz = turned(np.array(heading_rad), np.array(forward_m), np.array(left_m))
        ex, ez = turned(np.array(yaw), np.array(ahead), np.array(0.0))
        return Placement(float(spot[0] + dx + ex), float(spot[1] + dz + ez), float(yaw))

    def step(
        self,
        side: str,
        swing: Swing,
        *,
        heel_up_rad: float = 0.5,
        toe_up_rad: float = 0.0,
        rise_s: float = 0.15,
        roll_s: float = 0.08,
    ) -> None:
        """Let a foot leave the ground over its ball and land on its heel (or flat).

        Args:
            heel_up_rad: the foot's pitch when it lifts; it rises during `rise_s` before.
            toe_up_rad: its upward pitch when it lands (negative: on the ball); it rolls flat during `roll_s` after.
        """
        pitch, path = self.tracks[f"{side}.pitch"], self.feet[side]
        flat = pitch.last()
        base = float(flat.value[0])
        start = swing.lift_s - rise_s
        if start > flat.time_s + 0.01:
            pitch.key(start, base)
        elif flat.time_s > path.free_s > 0.0:  # too short a stance to roll down and up at full length
            pitch.keys.remove(flat)
            pitch.key(path.free_s + 0.42 * (swing.lift_s - path.free_s), base)
        pitch.key(swing.lift_s, heel_up_rad)
        pitch.key(swing.land_s, -toe_up_rad)
        pitch.key(swing.land_s + roll_s, 0.0)
        path.swings.append(swing)

    @property
    def spot(self) -> tuple[float, float]:
        """(x, z) between the ankles where the feet stand last."""
        points = []
        for side in SIDES:
            at, back = self.feet[side].current, float(self.body.sole(side).ankle_m[2])
            dx, dz = turned(np.array(at.yaw_rad), np.array(back), np.array(0.0))
            points.append((at.x_m + dx, at.z_m + dz))
        return float(np.mean([p[0] for p in points])), float(np.mean([p[1] for p in points]))

    @property
    def heading_rad(self) -> float:
        """The last heading."""
        return float(self.value("heading")[0])

    @property
    def front_rad(self) -> float:
        """The heading nearest to the last one that faces the cameras (whole turns add up)."""
        return float(2.0 * np.pi * np.round(self.heading_rad / (2.0 * np.pi)))

    # ---- chance

    def vary(self, value: float, share: float) -> float:
        """Scatter a value by `share` (a standard deviation, clipped at two) x variation."""
        draw = float(np.clip(self.rng.standard_normal(), -2.0, 2.0))
        return value * (1.0 + share * self.style.variation * draw)

    def jitter(self, deviation: float) -> float:
        """Return a random number of this deviation (clipped at two) x variation."""
        return deviation * self.style.variation * float(np.clip(self.rng.standard_normal(), -2.0, 2.0))


def _track_name(name: str) -> str:
    return name[0] + "." + name[2:] if name[:2] in ("l_", "r_") else name

"""Timeline of a performance: keys of all controls, and the feet's steps.

Behaviours append to it; `synthesise_motion` turns it into joint rotations. Because every behaviour starts at the
timeline's end, transitions need no blending of poses.
"""

import numpy as np
from numpy.typing import ArrayLike

from .arm_rotations import frame_from, hand_rest, unit
from .curves import Array, Track
from .feet import FootPath, Placement, Swing
from .proportions import SIDES, Body, outward, turned
from .style import Style

STANDING_HEIGHT = 0.997  # root height of a relaxed person, as a share of that with straight legs


class Timeline:
    """Keys of all controls and steps in one performance of one body with one style; radians, metres."""

    def __init__(self, body: Body, style: Style, rng: np.random.Generator) -> None:
        self.body, self.style, self.rng = body, style, rng
        self.time_s = 0.0
        self.natural_from_s = -1e9  # from here on the performer's own posture is added to the keys
        ease = self.at_ease()
        start: dict[str, ArrayLike] = {
            "heading": 0.0,  # direction that the body faces; 0 is +z, towards the cameras
            "height": self.standing_m,  # height of the root above the ground
            **{name: value for name, value in ease.items() if "." not in name},
            "sword": (0.0, -0.66, 0.42),  # left fist from the middle of the shoulders, in arms, in the heading's frame
            "aim": (0.45, 0.0, 0.0),  # blade's elevation, turn to the left, edge's turn about it from looking down
            "holds": 0.0,  # 1: the sword guides both hands, 0: each has a target; changes only while `guide` is 0
        }
        for side in SIDES:
            start |= {
                **{name: value for name, value in ease.items() if name.startswith(f"{side}.")},
                f"{side}.target": (0.0, -0.3, 0.2),  # wrist from the middle of the shoulders, in the heading's frame
                f"{side}.palm": (1.0, 0.0, 0.0, 0.0),  # heading-from-hand quaternion
                f"{side}.swivel": 0.3,  # elbow outwards from pointing down
            }
        self.tracks = {name: Track() for name in start}
        self.set(0.0, **start)
        self.feet = {side: FootPath(self.placement(side, 0.0, 0.0, 0.0)) for side in SIDES}

    # ---- keys

    def set(self, time_s: float, **values: ArrayLike) -> None:
        """Set keys at a time."""
        for name, value in values.items():
            self.tracks[name].key(time_s, value)

    def set_side(self, side: str, time_s: float, **values: ArrayLike) -> None:
        """Set keys of one side at a time, with names without "l." or "r."."""
        self.set(time_s, **{f"{side}.{name}": value for name, value in values.items()})

    def anchor(self, time_s: float, *names: str) -> None:
        """Hold the last values of controls (by default all) up to `time_s`, so that later keys start from there."""
        for name in names or self.tracks:
            last = self.tracks[name].keys[-1]
            if last.time_s < time_s - 1e-3:
                self.tracks[name].key(time_s, last.value)

    def value(self, name: str) -> Array:
        """Return the last value of a control."""
        return self.tracks[name].keys[-1].value

    def hand(self, side: str, time_s: float, target: ArrayLike, fingers: ArrayLike, palm: ArrayLike) -> None:
        """Key a guided hand's position (see `target`) and directions of fingers and palm."""
        along = unit(np.asarray(fingers, dtype=np.float64))
        facing = np.asarray(palm, dtype=np.float64)
        facing = unit(facing - (facing @ along) * along)
        turn = frame_from(*hand_rest(side), along[None], facing[None])[0]
        before = self.value(f"{side}.palm")
        self.set_side(side, time_s, target=target, palm=turn if turn @ before >= 0.0 else -turn)

    @property
    def standing_m(self) -> float:
        """Height of the root in relaxed standing."""
        return self.body.standing_m * STANDING_HEIGHT

    def stand(self, time_s: float) -> None:
        """Key relaxed standing."""
        self.set(time_s, height=self.standing_m, **self.at_ease())

    def at_ease(self) -> dict[str, ArrayLike]:
        """Return the controls' values for standing with hanging arms, in this style."""
        style = self.style
        values: dict[str, ArrayLike] = {
            "offset": (0.0, 0.0),  # root relative to its balanced position over the feet: left, forward
            "weight": 0.0,  # -1 all on the right foot, 1 all on the left, if both stand
            "pelvis": (0.0, 0.03 + 0.1 * style.slouch_rad, 0.0),  # yaw left, pitch, roll to the left against heading
            "spine": (0.02 + style.slouch_rad, 0.0, 0.0),  # chest's bend forward, to the left, twist against pelvis
            "head": (0.0, 0.05 + style.head_drop_rad, 0.0),  # yaw left, pitch down, roll against heading
        }
        for side in SIDES:
            lean = 0.5 * style.asymmetry * outward(side)
            values |= {
                f"{side}.arm": (0.04 + lean, 0.11, -0.15),  # swing forward, sideways, twist inwards
                f"{side}.elbow": max(0.12, 0.26 + style.elbows_rad + lean),  # flexion
                f"{side}.hand": (0.05, 0.12, 0.0),  # pronation, wrist flexion, bend to the little finger
                f"{side}.grip": 0.25,  # 0 open, 1 fist
                f"{side}.shrug": (0.0, 0.0),  # collar bone up, forward, in addition to what the arm's direction causes
                f"{side}.guide": 0.0,  # 0: arm by angles, 1: hand guided to `target` and `palm`
                f"{side}.pitch": 0.0,  # heel up
                f"{side}.pivot": 0.0,  # about the ball of the foot
                f"{side}.lift": 0.0,  # of a foot in the air, added to that of its swing
                f"{side}.knee": 0.3 * style.toe_out_rad,  # outwards
            }
        return values

    # ---- feet

    def placement(self, side: str, x_m: float, z_m: float, heading_rad: float, width: float = 1.0) -> Placement:
        """Return where a foot stands under a body at (x, z) that faces `heading_rad`.

        (x, z) is the ground point below the midpoint between the ankles.
        """
        aside = outward(side) * self.body.stance_m * width * self.style.width
        return self.placed(side, (x_m, z_m), heading_rad, aside, 0.0, outward(side) * self.style.toe_out_rad)

    def placed(
        self, side: str, spot: tuple[float, float], heading_rad: float, left_m: float, forward_m: float, yaw_rad: float
    ) -> Placement:
        """Return the placement for an ankle `left_m` and `forward_m` of a spot."""
        yaw = heading_rad + yaw_rad
        dx, dz = turned(heading_rad, forward_m, left_m)
        ex, ez = turned(yaw, -float(self.body.sole(side).ankle_m[2]), 0.0)
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
        """Make a foot leave the ground over its ball and land on its heel (or flat).

        Args:
            heel_up_rad: Pitch of the foot when it lifts; it rises during `rise_s` before.
            toe_up_rad: Upward pitch when it lands (negative: on the ball); it rolls flat during `roll_s` after.
        """
        pitch, path = self.tracks[f"{side}.pitch"], self.feet[side]
        flat = pitch.keys[-1]
        start = swing.lift_s - rise_s
        if start > flat.time_s + 0.01:
            pitch.key(start, flat.value)
        elif flat.time_s > path.free_s > 0.0:  # the stance is too short to roll down and up completely
            pitch.keys.remove(flat)
            pitch.key(path.free_s + 0.42 * (swing.lift_s - path.free_s), flat.value)
        pitch.key(swing.lift_s, heel_up_rad)
        pitch.key(swing.land_s, -toe_up_rad)
        pitch.key(swing.land_s + roll_s, 0.0)
        path.swings.append(swing)

    @property
    def spot(self) -> tuple[float, float]:
        """Point (x, z) between the ankles where the feet last stand."""
        points = []
        for side in SIDES:
            at = self.feet[side].current
            dx, dz = turned(at.yaw_rad, float(self.body.sole(side).ankle_m[2]), 0.0)
            points.append((at.x_m + dx, at.z_m + dz))
        x, z = np.mean(points, axis=0)
        return float(x), float(z)

    @property
    def heading_rad(self) -> float:
        """The last heading."""
        return float(self.value("heading")[0])

    # ---- randomness

    def vary(self, value: float, share: float) -> float:
        """Scatter a value by `share` (a standard deviation, clipped at two) times variation."""
        return value * (1.0 + self.jitter(share))

    def jitter(self, deviation: float) -> float:
        """Return a random number with this standard deviation (clipped at two) times variation."""
        return deviation * self.style.variation * float(np.clip(self.rng.standard_normal(), -2.0, 2.0))

    def one_of(self, count: int) -> int:
        """Return a random number below `count`."""
        return int(self.rng.integers(count))

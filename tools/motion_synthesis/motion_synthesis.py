"""Synthesis of a motion from a timeline: balance, legs, trunk, arms, head."""

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import SPINE_JOINTS
from perfanim.core.geometry import rotations as rot

from .arm_rotations import ARM_REACH, arm_rest, elbow, forearm_and_hand, hanging_arm, leg_rest, limited, two_bones, unit
from .curves import Array, ease, pendulum_filtered, smoothed, wander
from .feet import FootSamples, foot_pose, toe_bend
from .proportions import GRAVITY_M_S2, SIDES, about, outward, turned
from .sword import gripping
from .timeline import Timeline

_GRID_HZ = 240.0
_REACH = 0.997  # share of the leg's length, so that knees stay slightly bent
# shares of the trunk's forward bend, twist and side bend in lowerback, upperback, thorax, as in people's recordings
_TRUNK_SHARES = np.array([[0.55, 0.31, 0.53], [0.20, 0.47, 0.18], [0.25, 0.22, 0.29]])
_NECK_SHARES = np.array([[0.35], [0.35], [0.30]])
_NECK_RANGE_RAD = (0.9, 1.3)
# slow human sway and restlessness: standard deviations, radians or metres
_UNREST = {
    "offset": 0.005, "pelvis": 0.010, "spine": 0.014, "head": 0.022, "sword": 0.008, "aim": 0.012, "arm": 0.022,
    "elbow": 0.03, "hand": 0.035, "target": 0.006,
}  # fmt: skip
# how one person's posture differs from another's: standard deviations of constant differences, radians
_HABITS = {"pelvis": 0.015, "spine": 0.025, "head": 0.05, "arm": 0.05, "elbow": 0.06, "hand": 0.10}
_HABITS_IN_S = 0.8
# posture in the degrees of freedom that the controls leave open, radians about the left axis; means over ten people of
# the CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu): lower backs lean forward, chests back, necks forward
# again, toes are raised, hands hang straight, thumbs lie against the palm
_CARRIED = {"lowerback": 0.09, "thorax": -0.09, "lowerneck": -0.19, "upperneck": 0.265, "head": 0.16}
_TOES_RAISED_RAD, _HAND_RAISED, _THUMB_BENT = -0.12, 0.42, 0.30
_STRAIGHT_ELBOW_RAD = 0.04
_LEFT = np.array([1.0, 0.0, 0.0])


def synthesise_motion(timeline: Timeline, fps: float, name: str) -> Motion:
    """Return a timeline's motion from its start to `time_s`, sampled at `fps`."""
    synthesis = _MotionSynthesis(timeline, fps)
    root, orientation = synthesis.root()
    synthesis.put("root", orientation)
    synthesis.legs(root, orientation)
    chest = synthesis.trunk(orientation)
    synthesis.head(chest)
    synthesis.arms(root, orientation, chest)
    pick = slice(None, None, synthesis.per_frame)
    rotations = rot.continuous(rot.normalize(synthesis.local[pick]))
    return Motion(name=name, fps=fps, skeleton=timeline.body.skeleton, rotations=rotations, root_positions_m=root[pick])


class _MotionSynthesis:
    """Sampled controls of a timeline, and the pose built from them step by step."""

    def __init__(self, timeline: Timeline, fps: float) -> None:
        self.timeline, self.body = timeline, timeline.body
        self.per_frame = max(1, round(_GRID_HZ / fps))
        self.step_s = 1.0 / (fps * self.per_frame)
        count = round(timeline.time_s * fps) * self.per_frame + 1
        self.times = np.arange(count) * self.step_s
        self.tracks = {name: track.sample(self.times) for name, track in timeline.tracks.items()}
        self.carried = ease((self.times - timeline.natural_from_s) / _HABITS_IN_S)
        self._add_unrest()
        held = self.tracks["holds"] > 0.5
        for side in SIDES if np.any(held) else ():  # guide both hands along the sword's grip
            fist, arm_m = self.tracks["sword"] * self.body.arm_m, self.body.arm_m
            for name, value in zip(("target", "palm"), gripping(side, fist, self.tracks["aim"], arm_m), strict=True):
                self.tracks[f"{side}.{name}"] = np.where(held, value, self.tracks[f"{side}.{name}"])
        self.feet = {side: timeline.feet[side].sample(self.times) for side in SIDES}
        self.local = rot.identity((count, len(self.body.skeleton)))

    def _add_unrest(self) -> None:
        """Add small random motion and constant habits to the tracks, in place."""
        rng = np.random.default_rng(self.timeline.rng.integers(2**63))
        amount = 0.6 + 0.4 * self.timeline.style.variation
        for name, track in self.tracks.items():
            kind = name.split(".")[-1]
            if kind in _UNREST:
                track += _UNREST[kind] * amount * wander(rng, self.times, track.shape[1])
                habit = _HABITS.get(kind, 0.0) * np.clip(rng.standard_normal(track.shape[1]), -2.0, 2.0)
                track += habit * self.carried[:, None]

    def put(self, joint: str, rotations: Array) -> None:
        """Set the local rotations (T, 4) of a joint."""
        self.local[:, self.body.skeleton.index(joint)] = rotations

    # ---- root

    def root(self) -> tuple[Array, Array]:
        """Return the root's positions (T, 3) and orientations (T, 4)."""
        heading = self.tracks["heading"][:, 0]
        yaw, pitch, roll = self.tracks["pelvis"].T
        orientation = rot.multiply(rot.multiply(about("Y", heading + yaw), about("X", pitch)), about("Z", roll))
        left, forward = self.tracks["offset"].T
        ground = self._balanced() + np.stack(turned(heading, forward, left), axis=1)
        height = self._within_reach(self.tracks["height"][:, 0], ground, orientation)
        return np.stack((ground[:, 0], height, ground[:, 1]), axis=1), orientation

    def _balanced(self) -> Array:
        """Return the root's ground path (T, 2): an inverted pendulum above the supporting feet."""
        bias = self.tracks["weight"][:, 0]
        weights, points = [], []
        for side in SIDES:
            carries = self.timeline.feet[side].contact_weight(self.times, 0.12)
            weights.append(carries * (1.0 + outward(side) * bias))
            ground = self.feet[side].ground
            to_ankle = turned(ground[:, 2], np.full(len(ground), self.body.sole(side).ankle_m[2]), 0.0)
            points.append(ground[:, :2] + np.stack(to_ankle, axis=1))
        total = weights[0] + weights[1]
        known = total > 0.02
        share = np.where(known, weights[0] / np.where(known, total, 1.0), 0.5)[:, None]
        support = share * points[0] + (1.0 - share) * points[1]
        for axis in range(2):  # in flight the support moves straight from the last to the next contact
            support[~known, axis] = np.interp(self.times[~known], self.times[known], support[known, axis])
        rate = np.sqrt(GRAVITY_M_S2 / self.body.standing_m)
        return pendulum_filtered(support, float(rate), self.step_s)

    def _foot(self, side: str) -> tuple[Array, Array]:
        samples = self.feet[side]
        ground = samples.ground.copy()
        ground[:, 2] += self.tracks[f"{side}.pivot"][:, 0]
        raised = np.where(samples.in_contact, 0.0, self.tracks[f"{side}.lift"][:, 0])
        moved = FootSamples(ground, np.maximum(samples.lift_m + raised, 0.0), samples.swing_phase)
        return foot_pose(moved, self.body.sole(side), self.tracks[f"{side}.pitch"][:, 0])

    def _within_reach(self, height: Array, ground: Array, orientation: Array) -> Array:
        """Return the height, lowered smoothly where a leg would be too short."""
        excess = np.zeros_like(height)
        for side in SIDES:
            ankle, _ = self._foot(side)
            hip = rot.rotate(orientation, self.body.offset(f"{side}femur"))
            away = ankle[:, [0, 2]] - ground - hip[:, [0, 2]]
            leg = sum(self.body.lengths(f"{side}tibia", f"{side}foot"))
            room = (_REACH * leg) ** 2 - np.sum(away**2, axis=1)
            over = height - (ankle[:, 1] + np.sqrt(np.maximum(room, 1e-4)) - hip[:, 1])
            excess = np.maximum(excess, 0.003 * np.logaddexp(0.0, over / 0.003))
        sigma = 0.035 / self.step_s
        beside = round(1.2 * sigma)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(excess, beside, mode="edge"), 2 * beside + 1)
        widest = np.max(windows, axis=1)
        return np.asarray(height - smoothed(widest, sigma))

    # ---- legs

    def legs(self, root: Array, orientation: Array) -> None:
        """Pose the legs so that the feet are where the timeline places them."""
        for side in SIDES:
            sole = self.body.sole(side)
            ankle, foot = self._foot(side)
            hip = root + rot.rotate(orientation, self.body.offset(f"{side}femur"))
            # the knee's hinge lies between the left axes of pelvis and foot
            foot_left = rot.rotate(foot, rot.rotate(rot.conjugate(sole.flat), _LEFT))
            hinge = unit(0.8 * rot.rotate(orientation, _LEFT) + 0.2 * foot_left)
            out = about("Y", outward(side) * self.tracks[f"{side}.knee"][:, 0])
            thigh, shank = self.body.lengths(f"{side}tibia", f"{side}foot")
            rest = leg_rest(sole.flat)
            femur, flexion_rad = two_bones(hip, ankle, rot.rotate(out, hinge), (thigh, shank), rest)
            knee = rot.from_rotation_vector(rest[1] * flexion_rad[:, None])
            self.put(f"{side}femur", rot.multiply(rot.conjugate(orientation), femur))
            self.put(f"{side}tibia", knee)
            self.put(f"{side}foot", rot.multiply(rot.conjugate(rot.multiply(femur, knee)), foot))
            toes = toe_bend(self.feet[side], sole, self.tracks[f"{side}.pitch"][:, 0])
            bend = about("X", toes + _TOES_RAISED_RAD * self.carried)
            self.put(f"{side}toes", rot.multiply(rot.multiply(rot.conjugate(sole.flat), bend), sole.flat))

    # ---- trunk and head

    def trunk(self, orientation: Array) -> Array:
        """Bend the trunk; return the chest's orientation (T, 4)."""
        bend, side, twist = self.tracks["spine"].T
        whole = rot.multiply(rot.multiply(about("Y", twist), about("X", bend)), about("Z", -side))
        self._share_out(SPINE_JOINTS[:3], whole, _TRUNK_SHARES)
        chest = orientation
        for joint in SPINE_JOINTS[:3]:
            chest = rot.multiply(chest, self.local[:, self.body.skeleton.index(joint)])
        return chest

    def head(self, chest: Array) -> None:
        """Make the head look where the timeline says, stabilised against the trunk's motion."""
        yaw, pitch, roll = self.tracks["head"].T
        gaze = rot.multiply(about("Y", self.tracks["heading"][:, 0] + yaw), about("X", pitch))
        wanted = rot.multiply(gaze, about("Z", roll))
        whole = limited(rot.multiply(rot.conjugate(chest), wanted), *_NECK_RANGE_RAD)
        self._share_out(SPINE_JOINTS[3:], whole, _NECK_SHARES)

    def _share_out(self, joints: tuple[str, ...], whole: Array, shares: Array) -> None:
        """Distribute a rotation over joints, each leaning about its left axis as people do."""
        vector = rot.to_rotation_vector(whole)
        for joint, share in zip(joints, shares, strict=True):
            lean = about("X", _CARRIED.get(joint, 0.0) * self.carried)
            self.put(joint, rot.multiply(lean, rot.from_rotation_vector(share * vector)))

    # ---- arms

    def arms(self, root: Array, orientation: Array, chest: Array) -> None:
        """Pose collar bones, arms and hands."""
        neck, turn = root.copy(), orientation
        for joint in (*SPINE_JOINTS[:3], "lclavicle"):
            neck = neck + rot.rotate(turn, self.body.offset(joint))
            if joint in SPINE_JOINTS:
                turn = rot.multiply(turn, self.local[:, self.body.skeleton.index(joint)])
        middle = neck + rot.rotate(chest, 0.5 * (self.body.offset("lhumerus") + self.body.offset("rhumerus")))
        for side in SIDES:
            self._arm(side, neck, middle, chest)

    def _arm(self, side: str, neck: Array, middle: Array, chest: Array) -> None:
        heading = about("Y", self.tracks["heading"][:, 0])
        target = middle + rot.rotate(heading, self.tracks[f"{side}.target"])
        guide = self.tracks[f"{side}.guide"][:, 0]
        free = hanging_arm(side, *self.tracks[f"{side}.arm"].T)
        collar = self._collar_bone(side, free, rot.rotate(rot.conjugate(chest), target - neck), guide)
        from_collar = rot.conjugate(collar)
        arm = self._arm_by_angles(side, rot.multiply(from_collar, free))
        if np.any(guide > 0.0):
            shoulder = neck + rot.rotate(rot.multiply(chest, collar), self.body.offset(f"{side}humerus"))
            palm = rot.multiply(heading, rot.normalize(self.tracks[f"{side}.palm"]))
            led = self._arm_to_target(side, shoulder, target, chest, palm)
            led[0] = rot.multiply(from_collar, rot.multiply(rot.conjugate(chest), led[0]))
            arm = [rot.slerp(a, b, guide) for a, b in zip(arm, led, strict=True)]
        self.put(f"{side}clavicle", collar)
        for joint, rotation in zip(("humerus", "radius", "wrist", "hand"), arm, strict=True):
            self.put(side + joint, rotation)
        grip = self.tracks[f"{side}.grip"][:, 0]
        self.put(f"{side}fingers", about("Z", -outward(side) * 1.6 * grip))
        self.put(f"{side}thumb", about("Y", outward(side) * (0.6 * grip + _THUMB_BENT * self.carried)))

    def _collar_bone(self, side: str, free: Array, from_neck: Array, guide: Array) -> Array:
        """Return chest-from-collar-bone, following the arm up and forward; at rest in the T pose."""
        by_angle = rot.rotate(free, np.array([outward(side), 0.0, 0.0]))
        by_target = (from_neck - self.body.offset(f"{side}humerus")) / self.body.arm_m
        by_target = by_target / np.maximum(1.0, np.linalg.norm(by_target, axis=1, keepdims=True))
        _, up, forward = (by_angle + guide[:, None] * (by_target - by_angle)).T
        more_up, more_forward = self.tracks[f"{side}.shrug"].T
        raise_rad = np.where(up > 0.0, 0.35, -0.06) * up**2 + more_up
        reach_rad = np.where(forward > 0.0, 0.22, -0.10) * forward**2 + more_forward
        return rot.multiply(about("Y", -outward(side) * reach_rad), about("Z", outward(side) * raise_rad))

    def _arm_by_angles(self, side: str, humerus: Array) -> list[Array]:
        """Return local rotations of humerus, elbow, twist and hand for hanging and swinging arms."""
        pronation, flexion, aside = self.tracks[f"{side}.hand"].T
        raised = about("Z", outward(side) * (_HAND_RAISED * self.carried - flexion))
        wanted = self.tracks[f"{side}.elbow"][:, 0]
        bend = 0.5 * (wanted + np.sqrt(wanted**2 + _STRAIGHT_ELBOW_RAD**2))  # elbows do not bend backwards
        hand = rot.multiply(raised, about("Y", outward(side) * aside))
        return [humerus, elbow(side, bend), about("X", pronation), hand]

    def _arm_to_target(self, side: str, shoulder: Array, target: Array, chest: Array, palm: Array) -> list[Array]:
        """Return world-from-humerus and local elbow, twist and hand with which the target is reached."""
        swivel = self.tracks[f"{side}.swivel"][:, 0]
        along = unit(target - shoulder)
        # below a hand in front the elbow hangs; below one overhead it points forward
        raised = rot.rotate(rot.conjugate(chest), along)[:, 1]
        ahead = -0.3 + 1.4 * ease((raised + 0.3) / 1.2)
        down_out = np.stack((outward(side) * np.sin(swivel), -np.cos(swivel), ahead), axis=1)
        hinge = np.cross(rot.rotate(chest, down_out), along)
        upper, *fore = self.body.lengths(f"{side}radius", f"{side}wrist", f"{side}hand")
        first, flexion_rad = two_bones(shoulder, target, hinge, (upper, sum(fore)), arm_rest(side), ARM_REACH)
        bend = elbow(side, flexion_rad)
        return [first, bend, *forearm_and_hand(side, rot.multiply(first, bend), palm)]

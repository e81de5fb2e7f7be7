"""Armatures drawn by the tests: a stick figure in any rest pose, with any names, axes and unit."""

import numpy as np
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.armature_rest import ArmatureRest

# joint -> (parent, head in Blender's axes, metres, in a T pose)
_LEFT = {
    "lclavicle": ("chest", (0.03, 0.0, 1.42)),
    "lhumerus": ("lclavicle", (0.17, 0.01, 1.42)),
    "lradius": ("lhumerus", (0.45, 0.02, 1.42)),
    "lhand": ("lradius", (0.70, 0.01, 1.42)),
    "lfingers": ("lhand", (0.79, 0.01, 1.42)),
    "lindex": ("lhand", (0.79, -0.03, 1.42)),
    "lpinky": ("lhand", (0.77, 0.04, 1.42)),
    "lfemur": ("hips", (0.10, 0.0, 0.93)),
    "ltibia": ("lfemur", (0.11, -0.01, 0.51)),
    "lfoot": ("ltibia", (0.11, 0.02, 0.09)),
    "ltoes": ("lfoot", (0.12, -0.11, 0.02)),
}
_MIDDLE = {
    "ground": ("", (0.0, 0.0, 0.0)),
    "hips": ("ground", (0.0, 0.0, 0.98)),
    "spine": ("hips", (0.0, 0.0, 1.08)),
    "waist": ("spine", (0.0, 0.0, 1.13)),
    "belly": ("waist", (0.0, 0.0, 1.18)),
    "chest": ("belly", (0.0, 0.0, 1.28)),
    "neck": ("chest", (0.0, 0.01, 1.48)),
    "head": ("neck", (0.0, 0.0, 1.58)),
}
PLAIN = {
    **_MIDDLE,
    **_LEFT,
    **{
        "r" + name[1:]: (parent if parent in _MIDDLE else "r" + parent[1:], (-head[0], head[1], head[2]))
        for name, (parent, head) in _LEFT.items()
    },
}


def figure(
    names: dict[str, str] | None = None,
    *,
    arms_down_deg: float = 0.0,
    frame: np.ndarray | None = None,
    scale: float = 1.0,
    seed: int = 0,
) -> ArmatureRest:
    """A humanoid armature.

    Args:
        names: plain joint -> bone name; joints without one are left out, with their children on the next above.
        arms_down_deg: 0 a T pose, 45 an A pose.
        frame: (3, 3) how the armature's space lies in Blender's.
        seed: of the bones' axes, which are any.
    """
    names = {joint: joint for joint in PLAIN} if names is None else names
    turn = np.eye(3) if frame is None else frame
    random = np.random.default_rng(seed)
    bones, parents, heads = [], [], []
    for joint, (parent, head) in PLAIN.items():
        if joint not in names:
            continue
        while parent and parent not in names:
            parent = PLAIN[parent][0]
        point = np.array(head)
        if joint[1:] in ("radius", "hand", "fingers", "index", "pinky"):
            side = 1.0 if joint[0] == "l" else -1.0
            shoulder = np.array(PLAIN[joint[0] + "humerus"][1])
            lower = rot.from_rotation_vector(np.radians(arms_down_deg) * side * np.array([0.0, 1.0, 0.0]))
            point = shoulder + rot.rotate(lower, point - shoulder)
        bones.append(names[joint])
        parents.append(bones.index(names[parent]) if parent else -1)
        heads.append(scale * turn @ point)
    return armature(bones, parents, np.array(heads), random)


def armature(names: list[str], parents: list[int], heads: np.ndarray, random: np.random.Generator) -> ArmatureRest:
    """Bones at given places with any axes; tails point to a child, or on."""
    count = len(names)
    size = float(np.max(np.ptp(heads, axis=0)))
    tails = heads.copy()
    for bone in range(count):
        children = [child for child in range(count) if parents[child] == bone]
        above = heads[parents[bone]] if parents[bone] >= 0 else heads[bone] - 0.1 * size
        tails[bone] = heads[children[0]] if children else heads[bone] + 0.3 * (heads[bone] - above)
    axes = rot.to_matrix(rot.normalize(random.normal(size=(count, 4))))
    yes = np.ones(count, dtype=bool)
    return ArmatureRest(tuple(names), np.array(parents), heads, tails, axes, yes, yes, yes, np.ones(count), ~yes)

"""Motion read back from a character's bones, and written to them again without change.

The motion is that of the character's own body: its standard skeleton has the character's proportions, so neither
inverse kinematics nor a sole moves anything, and what is read and written again is the same pose.
"""

from dataclasses import replace

import numpy as np

from ..errors import CharacterError
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .leg_ik import readjusted_legs
from .retargeter import CharacterPose, RetargetPlan, RootMotion, apply_plan


def own_body_plan(plan: RetargetPlan) -> RetargetPlan:
    """Return a plan that copies the joints of the character's own skeleton to its bones; the inverse of `read_poses`.

    Args:
        plan: Plan from the character's own skeleton, whose root motion goes to the hips.

    Raises:
        CharacterError: The root motion goes to another bone or the object.
    """
    if plan.root_motion is not RootMotion.HIPS:
        raise CharacterError(
            f"the motion along the floor is on the {plan.root_motion.value}",
            advice="set Root Motion to Hips, and put the take on the character again",
        )
    return replace(plan, legs=None, forearms=(), is_direct=False)


def read_poses(plan: RetargetPlan, pose: CharacterPose) -> tuple[Array, Array]:
    """Return local rotations (F, J, 4) and root positions (F, 3) of a character's own body.

    Joints without a bone keep the rest pose relative to their parent.

    Args:
        plan: Plan from the character's own skeleton, with the adjustments that the pose was made with.
        pose: Rotations (F, N, 4) of the bones of `plan.bones`, and locations (F, 1, 3).
    """
    skeleton = plan.skeleton
    bones = pose.rotations
    if len(plan.adjusted):
        bones = bones.copy()
        bones[:, plan.adjusted] = rot.multiply(bones[:, plan.adjusted], rot.conjugate(plan.adjustments))
    relative = np.matmul(np.swapaxes(plan.maps, -1, -2), bones[..., None])[..., 0]
    turned = np.empty_like(relative)
    for place, above in enumerate(plan.ancestors.tolist()):  # parents come first
        turned[:, place] = rot.multiply(turned[:, above], relative[:, place]) if above >= 0 else relative[:, place]
    world = _joint_rotations(plan, turned)
    local = world.copy()
    has = skeleton.parents >= 0
    local[:, has] = rot.multiply(rot.conjugate(world[:, skeleton.parents[has]]), world[:, has])
    fit, carriers = plan.alignment, plan.carriers
    hips = pose.locations[:, 0] @ np.linalg.inv(carriers.mover_axes).T + carriers.hips_head
    return rot.normalize(local), hips @ fit.armature_from_world / fit.units_per_metre


def _joint_rotations(plan: RetargetPlan, turned: Array) -> Array:
    """Return the world rotations (F, J, 4) of the joints; those without a bone turn with their parent."""
    skeleton = plan.skeleton
    places = {skeleton.index(joint): place for joint, place in plan.places.items()}
    world = np.empty((len(turned), len(skeleton), 4))
    for joint, parent in enumerate(skeleton.parents.tolist()):
        world[:, joint] = turned[:, places[joint]] if joint in places else world[:, parent]
    return world


def readjusted(before: RetargetPlan, after: RetargetPlan, pose: CharacterPose) -> CharacterPose:
    """Return a pose that was made with some adjustments as it would be with others.

    Args:
        before, after: Plans from the character's own skeleton that differ in their adjustments.
        pose: Rotations (F, N, 4) and locations (F, 1, 3) made with `before`.
    """
    rotations, roots_m = read_poses(before, pose)
    assert before.legs is not None and after.legs is not None  # noqa: S101 - no plans of the same body
    legs = readjusted_legs(before.legs, after.legs)
    return apply_plan(replace(after, legs=legs, forearms=()), rotations, roots_m)

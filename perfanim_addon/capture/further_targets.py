"""All that a capture moves besides the first performer's character: objects with props, characters with performers."""

from collections.abc import Collection, Sequence

import bpy

from ...core.body.scene_pose import ScenePose
from ...core.markers.prop import Prop
from ...core.markers.subject import Subject
from ...core.retarget.retargeter import RetargetPlan
from .capture_space import CaptureSpace
from .performer_driver import PerformerDriver, Role
from .prop_driver import TargetDriver


class Others:
    """Moves all that, live.

    Args:
        props, performers: of the capture, in the order of its poses' props and others.
        parts: of the body that are moved.

    Raises:
        CharacterError: a chosen object or armature cannot follow.
    """

    def __init__(
        self, context: bpy.types.Context, props: Sequence[Prop], performers: Sequence[Subject], parts: Collection[str]
    ) -> None:
        self.props = tuple(props)
        self._targets = TargetDriver(context, props)
        self._performers = PerformerDriver(context, performers, parts)
        self._room: CaptureSpace | None = None

    @property
    def roles(self) -> list[Role]:
        """The further performers, with the characters that move along by now."""
        return self._performers.roles

    def enter(self, context: bpy.types.Context, armature_object: bpy.types.Object, plan: RetargetPlan) -> None:
        """Go on in the room of the first performer's character; further performers without one get a new one."""
        self._room = CaptureSpace(armature_object, plan)
        self._performers.enter(context, self._room)

    def apply(self, context: bpy.types.Context, frames: Sequence[ScenePose]) -> None:
        """Show the last of all poses of the capture so far."""
        if self._room is not None:
            self._targets.apply(context, frames[-1].props, self._room)
            self._performers.apply(frames)

    def apply_again(self) -> None:
        """Pose the characters as last, after an animation has overwritten that."""
        self._performers.apply_again()

    def restore(self) -> None:
        """Give objects and characters the actions back that were taken off."""
        self._targets.restore()
        self._performers.restore()

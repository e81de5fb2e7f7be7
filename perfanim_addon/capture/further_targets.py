"""All that a capture moves besides the first performer's character: objects with props, characters with performers."""

from collections.abc import Collection, Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.scene_pose import PerformerPose
from ...core.body.skeleton import Skeleton
from ...core.markers.prop import Prop
from ...core.markers.subject import Subject
from ..character.create_character import find_armature
from ..character.posing import Posing, posing_of
from ..settings.result_settings import placement
from .capture_space import CaptureSpace
from .performer_driver import PerformerDriver, Role, write_performer_actions
from .prop_driver import TargetDriver, write_prop_actions

Array = NDArray[np.float64]


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

    def enter(self, context: bpy.types.Context, armature_object: bpy.types.Object, posing: Posing) -> None:
        """Go on in the room of the first performer's character; further performers without one get a new one."""
        self._room = CaptureSpace(armature_object, posing)
        self._performers.enter(context, self._room)

    def apply(self, context: bpy.types.Context, frames: Sequence[PerformerPose]) -> None:
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


def write_others(
    context: bpy.types.Context,
    object_name: str,
    skeleton: Skeleton,
    props: Sequence[Prop],
    roles: Sequence[Role],
    frames: Sequence[PerformerPose],
    recorded: Sequence[PerformerPose],
    at: Array,
    name: str,
) -> list[str]:
    """Write where props were as actions of the objects that follow them, and further performers' motion as actions of
    their characters, as is chosen; return the actions' names.

    Args:
        object_name, skeleton: the first performer's character, in whose room all is, and the performer's own.
        props, roles: in the order of the poses' props and others.
        frames: all poses of the capture or take.
        recorded, at: (F,) those that are written, and the scene frame of each.
        name: wished name of the actions, before that of the prop or performer.

    Raises:
        CharacterError: an object or a character cannot be animated.
    """
    if not props and not roles:
        return []
    armature = find_armature(object_name)
    room = CaptureSpace(armature, posing_of(armature, skeleton))
    moved = write_prop_actions(context, props, recorded, at, room, name, placement(context, None))
    return moved + write_performer_actions(context, roles, frames, recorded, at, room, name)

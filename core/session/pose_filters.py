"""What is done to solved poses before they are shown and baked: smoothing, feet held in place. Takes keep neither."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..body.foot_lock import FootLock
from ..body.one_euro import PoseSmoother
from ..body.scene_pose import PerformerPose, PropPose
from ..body.skeleton import Skeleton


@dataclass(frozen=True)
class FilterSettings:
    """What is asked for.

    Args:
        smoothing_s: delay of a slow motion (see `PoseSmoother`), 0 for none.
        feet: mode of `FootLock`.
    """

    smoothing_s: float = 0.0
    feet: str = "off"

    @staticmethod
    def of_table(table: Mapping[str, Any]) -> "FilterSettings":
        """Return the shape that a JSON object describes; what it leaves out is off."""
        return FilterSettings(float(table.get("smoothing_s", 0.0)), str(table.get("feet", "off")))


class PoseFilter:
    """Shapes poses one after another.

    Args:
        skeleton: the performer's.
        floor_m: height of the floor in the world of the poses, None where nobody knows it.
        shape: what is asked for.
        others: skeletons of the further performers.

    Raises:
        SettingsError: there is no such mode for the feet.
    """

    def __init__(
        self, skeleton: Skeleton, floor_m: float | None, shape: FilterSettings, others: Sequence[Skeleton] = ()
    ) -> None:
        self._skeleton = skeleton
        self._floor_m = floor_m
        self._shape = shape
        self._smoother = PoseSmoother(shape.smoothing_s)
        self._feet = FootLock(skeleton, shape.feet, floor_m)
        self._props: list[PoseSmoother] = []
        self._others = [PoseFilter(other, floor_m, shape) for other in others]

    def tune(self, shape: FilterSettings) -> None:
        """Go on with another shape; errors as at construction."""
        self._smoother.delay_s = shape.smoothing_s
        if shape.feet != self._shape.feet:
            self._feet = FootLock(self._skeleton, shape.feet, self._floor_m)
        self._shape = shape
        for other in self._others:
            other.tune(shape)

    def step(self, pose: PerformerPose) -> PerformerPose:
        """Return the next pose as it is shown; the very same when nothing is asked for."""
        if self._shape == FilterSettings():
            return pose
        rotations, root = self._smoother.step(pose.time_s, pose.rotations, pose.root_position_m)
        held = self._feet.step(pose.time_s, rotations, root)
        others = tuple(shaper.step(other) for shaper, other in zip(self._others, pose.others, strict=True))
        return replace(pose, rotations=held, root_position_m=root, props=self._shaped_props(pose), others=others)

    def _shaped_props(self, pose: PerformerPose) -> tuple[PropPose, ...]:
        """Return the props as calm as the body, and as late: what is held stays in the hand."""
        if len(self._props) != len(pose.props):
            self._props = [PoseSmoother(self._shape.smoothing_s) for _ in pose.props]
        shaped = []
        for smoother, prop in zip(self._props, pose.props, strict=True):
            smoother.delay_s = self._shape.smoothing_s
            if prop.found:
                turns, place = smoother.step(pose.time_s, prop.rotation[None], prop.position_m)
                prop = replace(prop, rotation=turns[0], position_m=place)
            shaped.append(prop)
        return tuple(shaped)


def filter_poses(
    poses: Sequence[PerformerPose],
    skeleton: Skeleton,
    floor_m: float | None,
    shape: FilterSettings,
    others: Sequence[Skeleton] = (),
) -> list[PerformerPose]:
    """Return the poses of a take as they are shown; arguments and errors as of `PoseFilter`."""
    shaper = PoseFilter(skeleton, floor_m, shape, others)
    return [shaper.step(pose) for pose in poses]

"""Filters of solved poses for display and keyframes: smoothing and foot lock.

Takes store the poses as they were solved.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

from ..body.foot_lock import FootLock
from ..body.one_euro import PoseSmoother
from ..body.scene_pose import PerformerPose, PropPose, ScenePose
from ..errors import SettingsError
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..system.schema import About, Schema, Table, table_of


@dataclass(frozen=True)
class FilterSettings:
    """Settings of `PoseFilter`."""

    smoothing_s: Annotated[float, About("delay of a slow motion (see `PoseSmoother`), 0 for none", "s", 0.0, 60.0)] = (
        0.0
    )
    feet: Annotated[str, About("mode of `FootLock`")] = "off"
    immediate: Annotated[bool, About("show a capture's poses as solved, not smoothed two frames later")] = False

    @staticmethod
    def of_table(table: Table) -> "FilterSettings":
        """Return the settings from a JSON object; SettingsError if they are invalid."""
        return _SCHEMA.read(table, "filter")

    def table(self) -> dict[str, Any]:
        """Return the settings as a JSON object."""
        return table_of(self)


_SCHEMA = Schema(FilterSettings, "Filter", "Filter of poses.", SettingsError, "choose smoothing and feet again")


class PoseFilter:
    """Filters the poses of a capture one after another.

    Args:
        floor_m: Height of the floor in the world of the poses; None if unknown.

    Raises:
        SettingsError: The mode for the feet is unknown.
    """

    def __init__(self, performers: Sequence[Subject], floor_m: float | None, settings: FilterSettings) -> None:
        self._settings = settings
        self._performers = [_PerformerFilter(performer, floor_m, settings) for performer in performers]
        self._props: list[PoseSmoother] = []

    def set_settings(self, settings: FilterSettings) -> None:
        """Change the settings; errors are those of the constructor."""
        for performer in self._performers:
            performer.set_settings(settings)
        self._settings = settings

    @property
    def is_immediate(self) -> bool:
        """Whether poses are to be shown as soon as they are solved, not delayed (see `delayed_poses`)."""
        return self._settings.immediate

    def step(self, pose: ScenePose) -> ScenePose:
        """Return the next pose, filtered; the same object if all filters are off."""
        if (self._settings.smoothing_s, self._settings.feet) == (0.0, "off"):
            return pose
        performers = tuple(
            performer.step(body) for performer, body in zip(self._performers, pose.performers, strict=True)
        )
        return replace(pose, performers=performers, props=self._smooth_props(pose))

    def _smooth_props(self, pose: ScenePose) -> tuple[PropPose, ...]:
        """Return the props, smoothed like the performers, so that a held prop stays in the hand."""
        if len(self._props) != len(pose.props):
            self._props = [PoseSmoother(self._settings.smoothing_s) for _ in pose.props]
        smoothed = []
        for smoother, prop in zip(self._props, pose.props, strict=True):
            smoother.delay_s = self._settings.smoothing_s
            if prop.found:
                rotations, position_m = smoother.step(pose.time_s, prop.rotation[None], prop.position_m)
                prop = replace(prop, rotation=rotations[0], position_m=position_m)
            smoothed.append(prop)
        return tuple(smoothed)


class _PerformerFilter:
    def __init__(self, performer: Subject, floor_m: float | None, settings: FilterSettings) -> None:
        self._performer = performer
        self._floor_m = floor_m
        self._smoother = PoseSmoother(settings.smoothing_s)
        self._feet = self._lock(settings.feet)
        self._time_s = float("nan")

    def set_settings(self, settings: FilterSettings) -> None:
        self._smoother.delay_s = settings.smoothing_s
        if settings.feet != self._feet.mode:
            self._feet = self._lock(settings.feet)

    def _lock(self, mode: str) -> FootLock:
        lasting_m = noise_of(self._performer.marker_set.points).lasting_m
        return FootLock(self._performer.skeleton, mode, self._floor_m, lasting_m)

    def step(self, pose: PerformerPose) -> PerformerPose:
        if pose.time_s != self._time_s:  # a rejected frame repeats the last pose
            self._time_s = pose.time_s
            rotations, root = self._smoother.step(pose.time_s, pose.rotations, pose.root_position_m)
            self._shown = self._feet.step(pose.time_s, rotations, root), root
        rotations, root = self._shown
        return replace(pose, rotations=rotations, root_position_m=root)


def filter_poses(
    poses: Sequence[ScenePose], performers: Sequence[Subject], floor_m: float | None, settings: FilterSettings
) -> list[ScenePose]:
    """Return the poses of a take, filtered; arguments and errors are those of `PoseFilter`."""
    pose_filter = PoseFilter(performers, floor_m, settings)
    return [pose_filter.step(pose) for pose in poses]

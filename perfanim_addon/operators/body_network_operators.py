"""Operators for the body network, which finds a person without markers."""

from typing import Any

import bpy

from ...core.errors import DownloadError
from ..preferences.online import is_online_allowed
from .job_operators import FilesOperator, JobOperator

PANEL = "cameras"
_DONE = "the body network is there"


class _Getting(JobOperator):
    """Base of the operators that bring the network."""

    title = "Getting the body network"
    panel = PANEL
    needs_scene = False  # the preferences have a button, too

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        return _DONE


class PERFANIM_OT_get_body_network(_Getting, bpy.types.Operator):
    """Download the network that finds a person without markers: BlazePose by Google, Apache License 2.0.
    35 MB are downloaded with pip, of which 6 MB are kept"""

    bl_label = "Get Body Network"

    def arguments(self, context: bpy.types.Context) -> list[str]:
        if not is_online_allowed():
            advice = "enable Allow Online Access in Preferences > System, or open a file of your own"
            raise DownloadError("online access is off", advice=advice)
        return ["network", "get"]


class PERFANIM_OT_open_body_network(_Getting, FilesOperator, bpy.types.Operator):
    """Take the body network from a file: pose_landmark_full.tflite, a wheel of mediapipe 0.10.14,
    or a folder with one"""

    bl_label = "Open Body Network"
    filter_glob: bpy.props.StringProperty(default="*.tflite;*.whl", options={"HIDDEN"})

    def arguments(self, context: bpy.types.Context) -> list[str]:
        return ["network", "get", "--from", self.chosen_files()[0]]

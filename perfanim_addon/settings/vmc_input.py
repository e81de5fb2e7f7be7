"""Settings of trackers received by VMC instead of cameras, stored in the scene."""

from typing import Any

import bpy

from ...core.formats.vmc.ports import PERFORMER_PORT
from ...core.worker.requests import TrackerSource
from ..preferences.attach_settings import attach_property_group
from ..preferences.online import is_online_allowed, is_this_computer
from ..preferences.property_kinds import string, whole_number

THIS_COMPUTER = "127.0.0.1"


class PERFANIM_PG_receiving(bpy.types.PropertyGroup):
    """Sender of the trackers."""

    port: whole_number("Port", "UDP port of this computer that receives the trackers", PERFORMER_PORT, 1, 65535)
    sender: string(
        "Sender",
        "Name or address of the sending computer; empty accepts every sender: for trusted networks only",
        THIS_COMPUTER,
    )


def problem(chosen: Any) -> str:
    """Return the reason why trackers cannot be received, "" for none."""
    sender = chosen.sender.strip()
    if is_online_allowed() or (sender and is_this_computer(sender)):
        return ""
    return f"Online access is off: only programs on this computer ({THIS_COMPUTER}) can send"


def source(scene: bpy.types.Scene) -> TrackerSource:
    """Return the trackers as a source for the worker."""
    chosen = scene.perfanim_receiving
    return TrackerSource(chosen.port, sender=chosen.sender.strip())


register, unregister = attach_property_group(bpy.types.Scene, "perfanim_receiving", PERFANIM_PG_receiving)

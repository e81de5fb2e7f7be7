"""Settings of the VMC output of a capture, stored in the scene."""

from typing import Any

import bpy

from ...core.formats.vmc.ports import MARIONETTE_PORT
from ...core.worker.requests import VmcTarget
from ..preferences.attach_settings import attach_property_group
from ..preferences.online import is_online_allowed, is_this_computer
from ..preferences.property_kinds import string, switch, whole_number


class PERFANIM_PG_sending(bpy.types.PropertyGroup):
    """Receiver of the live motion."""

    on: switch(
        "Send by VMC",
        "Send the live motion to another program (avatars, game engines) over the Virtual Motion Capture protocol",
    )
    host: string("Host", "Name or address of the receiving computer", "127.0.0.1")
    port: whole_number("Port", "UDP port of the receiving program", MARIONETTE_PORT, 1, 65535)


def problem(chosen: Any) -> str:
    """Return the reason why nothing can be sent, "" for none."""
    if not chosen.host.strip():
        return "Enter the receiving computer"
    if not is_online_allowed() and not is_this_computer(chosen.host.strip()):
        return "Online access is off: 127.0.0.1 only"
    return ""


def target(scene: bpy.types.Scene) -> VmcTarget | None:
    """Return the receiver, None if sending is off."""
    chosen = scene.perfanim_sending
    return VmcTarget(chosen.host.strip(), chosen.port) if chosen.on and not problem(chosen) else None


register, unregister = attach_property_group(bpy.types.Scene, "perfanim_sending", PERFANIM_PG_sending)

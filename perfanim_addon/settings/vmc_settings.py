"""Settings for VMC, stored in the scene: trackers received instead of cameras, and motion sent by a capture."""

from typing import Any

import bpy

from ...core.formats.vmc.ports import MARIONETTE_PORT, PERFORMER_PORT
from ...core.worker.requests import VmcTarget
from ..preferences.online import is_online_allowed, is_this_computer
from ..preferences.property_kinds import string, switch, whole_number

THIS_COMPUTER = "127.0.0.1"


class PERFANIM_PG_receiving(bpy.types.PropertyGroup):
    """Sender of the trackers."""

    attached_to = (bpy.types.Scene, "perfanim_receiving")
    port: whole_number("Port", "UDP port of this computer that receives the trackers", PERFORMER_PORT, 1, 65535)
    sender: string(
        "Sender",
        "Name or address of the sending computer; empty accepts every sender: for trusted networks only",
        THIS_COMPUTER,
    )


class PERFANIM_PG_sending(bpy.types.PropertyGroup):
    """Receiver of the live motion."""

    attached_to = (bpy.types.Scene, "perfanim_sending")
    on: switch(
        "Send by VMC",
        "Send the live motion to another program (avatars, game engines) over the Virtual Motion Capture protocol",
    )
    host: string("Host", "Name or address of the receiving computer", THIS_COMPUTER)
    port: whole_number("Port", "UDP port of the receiving program", MARIONETTE_PORT, 1, 65535)


def receiving_problem(chosen: Any) -> str:
    """Return the reason why trackers cannot be received, or ""."""
    sender = chosen.sender.strip()
    if is_online_allowed() or (sender and is_this_computer(sender)):
        return ""
    return f"Online access is off: only programs on this computer ({THIS_COMPUTER}) can send"


def sending_problem(chosen: Any) -> str:
    """Return the reason why nothing can be sent, or ""."""
    if not chosen.host.strip():
        return "Enter the receiving computer"
    if not is_online_allowed() and not is_this_computer(chosen.host.strip()):
        return f"Online access is off: {THIS_COMPUTER} only"
    return ""


def target(scene: bpy.types.Scene) -> VmcTarget | None:
    """Return the receiver, or None if sending is off."""
    chosen = scene.perfanim_sending
    return VmcTarget(chosen.host.strip(), chosen.port) if chosen.on and not sending_problem(chosen) else None

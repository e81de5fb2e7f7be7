"""Where the live character is sent to: kept in the scene."""

import ipaddress
from typing import Any

import bpy

from ...core.formats.vmc.ports import MARIONETTE_PORT
from ..preferences.attach_settings import hung_on


class PERFANIM_PG_sending(bpy.types.PropertyGroup):
    """Where the live character is sent to."""

    on: bpy.props.BoolProperty(
        name="Send by VMC",
        description="While capturing, send the performer's motion to another program (avatars, game engines) by the "
        "Virtual Motion Capture protocol",
        default=False,
    )
    host: bpy.props.StringProperty(
        name="Host", description="Name or address of the computer on which that program runs", default="127.0.0.1"
    )
    port: bpy.props.IntProperty(
        name="Port",
        description="UDP port on which that program listens",
        default=MARIONETTE_PORT,
        min=1,
        max=65535,
    )


def problem(chosen: Any) -> str:
    """Return why nothing can be sent, "" when it can."""
    if not chosen.host.strip():
        return "Name the computer to send to"
    if not is_online_allowed() and not is_this_computer(chosen.host.strip()):
        return "Online access is off: 127.0.0.1 only"
    return ""


def is_online_allowed() -> bool:
    """Return whether the user lets add-ons use the network."""
    return bool(bpy.app.online_access)


def is_this_computer(host: str) -> bool:
    """Return whether a name or an address is that of the computer itself."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def target(scene: bpy.types.Scene) -> list[Any]:
    """Return host and port to which a capture sends, [] when it sends nothing."""
    chosen = scene.perfanim_sending
    return [chosen.host.strip(), chosen.port] if chosen.on and not problem(chosen) else []


register, unregister = hung_on(bpy.types.Scene, "perfanim_sending", PERFANIM_PG_sending)

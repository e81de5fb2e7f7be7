"""Which program sends trackers, where they take the place of cameras: kept in the scene."""

from typing import Any

import bpy

from ...core.formats.vmc.ports import PERFORMER_PORT
from ..preferences.attach_settings import hung_on
from . import vmc_output

THIS_COMPUTER = "127.0.0.1"


class PERFANIM_PG_receiving(bpy.types.PropertyGroup):
    """Which program sends trackers."""

    port: bpy.props.IntProperty(
        name="Port",
        description="UDP port of this computer to which the other program sends",
        default=PERFORMER_PORT,
        min=1,
        max=65535,
    )
    sender: bpy.props.StringProperty(
        name="Sender",
        description="Name or address of the only computer that is listened to; empty: all that send, so keep to "
        "networks that you trust",
        default=THIS_COMPUTER,
    )


def problem(chosen: Any) -> str:
    """Return why nothing can be received, "" when it can."""
    sender = chosen.sender.strip()
    if vmc_output.is_online_allowed() or (sender and vmc_output.is_this_computer(sender)):
        return ""
    return f"Online access is off: programs of this computer only, {THIS_COMPUTER}"


def source(scene: bpy.types.Scene) -> dict[str, Any]:
    """Return the description of the source, as `core.worker.tracker_job` takes it."""
    chosen = scene.perfanim_receiving
    return {"kind": "vmc", "port": chosen.port, "sender": chosen.sender.strip()}


register, unregister = hung_on(bpy.types.Scene, "perfanim_receiving", PERFANIM_PG_receiving)

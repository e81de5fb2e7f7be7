"""Permission to use the network."""

import ipaddress

import bpy


def is_online_allowed() -> bool:
    """Return True if add-ons are allowed to use the network."""
    return bool(bpy.app.online_access)


def is_this_computer(host: str) -> bool:
    """Return True for a name or address of this computer."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"

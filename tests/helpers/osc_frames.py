"""VMC frames built by the OSC library alone, for comparison with what is sent."""

import numpy as np
from perfanim.core.formats.vmc.vmc_packets import AVAILABLE, BONE, ROOT, TIME
from perfanim.core.geometry import rotations as rot
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder


def frame_packet(time_s, names, positions_m, rotations):
    """The bundle of one frame: available, time, root in the origin, and bones (B, 3), (B, 4) in our axes."""
    bundle = OscBundleBuilder(IMMEDIATELY)
    bundle.add_content(_message(AVAILABLE, (1,), "i"))
    bundle.add_content(_message(TIME, (time_s,)))
    bundle.add_content(_placed(ROOT, "root", np.zeros(3), rot.identity()))
    for name, position, rotation in zip(names, positions_m, rotations, strict=True):
        bundle.add_content(_placed(BONE, name, position, rotation))
    return bundle.build().dgram


def _placed(address, name, position_m, rotation):
    w, x, y, z = (np.array([1.0, 1.0, -1.0, -1.0]) * rotation).tolist()
    numbers = (*(np.array([-1.0, 1.0, 1.0]) * position_m).tolist(), x, y, z, w)
    return _message(address, (name, *numbers))


def message(address, *values, tags=None):
    """The packet of one message: texts and floats, unless `tags` say otherwise."""
    return _message(address, values, tags).dgram


def _message(address, values, tags=None):
    builder = OscMessageBuilder(address)
    for value, tag in zip(values, tags or ["s" if isinstance(value, str) else "f" for value in values], strict=True):
        builder.add_arg(value, tag)
    return builder.build()

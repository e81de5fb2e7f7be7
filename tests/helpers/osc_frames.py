"""VMC frames built by the OSC library alone, for comparison with what is sent."""

import numpy as np
from perfanim.core.formats.vmc.vmc_packets import AVAILABLE, BONE, ROOT, TIME
from perfanim.core.geometry import rotations as rot
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder


def frame_packet(time_s, names, positions_m, rotations):
    """The bundle of one frame: available, time, root in the origin, and bones (B, 3), (B, 4) in our axes."""
    bundle = OscBundleBuilder(IMMEDIATELY)
    bundle.add_content(_message(AVAILABLE, ("i", 1)))
    bundle.add_content(_message(TIME, ("f", time_s)))
    bundle.add_content(_placed(ROOT, "root", np.zeros(3), rot.identity()))
    for name, position, rotation in zip(names, positions_m, rotations, strict=True):
        bundle.add_content(_placed(BONE, name, position, rotation))
    return bundle.build().dgram


def _placed(address, name, position_m, rotation):
    w, x, y, z = (np.array([1.0, 1.0, -1.0, -1.0]) * rotation).tolist()
    numbers = (*(np.array([-1.0, 1.0, 1.0]) * position_m).tolist(), x, y, z, w)
    return _message(address, ("s", name), *(("f", number) for number in numbers))


def _message(address, *arguments):
    builder = OscMessageBuilder(address)
    for tag, value in arguments:
        builder.add_arg(value, tag)
    return builder.build()

"""Trackers of another program, by VMC, to marker frames: in place of the cameras.

Request: "source" (kind "vmc", "port" to listen on, "sender": name or address of the only computer to accept, "" for
all), "marker_set" (table of the worn one). A process that takes another's place also gets "after".
"""

import time
from collections.abc import Mapping
from typing import Any

from ...formats.vmc.link import Receiver
from ...formats.vmc.tracker_stream import TrackerStream
from ...markers.label_matching import join_names
from ...markers.marker_set import marker_set_from
from ..channel import Channel, open_when_free

_LOOK_S = 0.1
_SILENT_S = 1.0  # without a marker until the reason is sent


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Send marker frames until STOP.

    Raises:
        PerfanimError: the port is taken or the sender is not known.
    """
    sender = str(request["source"].get("sender", ""))
    stream = TrackerStream(marker_set_from(request["marker_set"], "trackers"))
    port, takes_place = int(request["source"]["port"]), request.get("after") is not None
    with open_when_free(lambda: Receiver(port, sender), takes_place, channel.stop_requested) as receiver:
        channel.send_status(f"waiting for trackers on port {receiver.port}")
        silence = _Silence(receiver, stream, sender, channel)
        while not channel.stop_requested.is_set():
            packet = receiver.receive(_LOOK_S)
            now_s = time.perf_counter()
            frames = stream.add(packet, now_s) if packet is not None else []
            for frame in frames:
                channel.send_frame(now_s, frame)
            silence.update(now_s, bool(frames))


class _Silence:
    """Warns once why no markers come, once that they are back, and once of a flood."""

    def __init__(self, receiver: Receiver, stream: TrackerStream, sender: str, channel: Channel) -> None:
        self._receiver, self._stream, self._channel = receiver, stream, channel
        self._from = f" from {sender}" if sender else ""
        self._warning = ""
        self._hears = self._came = self._flooded = False
        self._since_s = time.perf_counter()

    def update(self, now_s: float, came: bool) -> None:
        """Note whether markers have come."""
        if self._stream.gathering.flooding and not self._flooded:
            self._flooded = True
            where = f"on port {self._receiver.port}"
            self._channel.send_warning(f"too much comes {where}, most is not read: let a single program send there")
        if came:
            if self._warning:
                self._channel.send_warning("", standing=True)
            if self._warning and self._came:
                self._channel.send_warning(f"the trackers are back after {now_s - self._since_s:.1f} s")
            self._since_s, self._came, self._warning = now_s, True, ""
        elif not self._hears and self._stream.gathering.understood:
            self._hears, self._since_s = True, now_s  # what it sends is known when it has sent all of it once
        elif now_s - self._since_s > _SILENT_S:
            reason = self._reason()
            if reason != self._warning:
                self._warning = reason
                self._channel.send_warning(reason, standing=True)

    def _reason(self) -> str:
        where = f"on port {self._receiver.port}{self._from}"
        if self._came:
            return f"no trackers come any more {where}: the capture goes on when they do"
        if not self._stream.gathering.packets and self._receiver.strangers:
            others = ", ".join(sorted(self._receiver.strangers))
            return f"nothing comes {where}, but from {others}: choose who sends under Cameras"
        if not self._stream.gathering.packets:
            return f"nothing comes {where}: let the other program send to this computer and port"
        if not self._stream.gathering.understood:
            return f"what comes {where} is not VMC: choose this protocol in the other program"
        if not self._stream.trackers:
            return f"no trackers come {where}: have the other program send them, not only bones"
        return (
            f"the trackers {join_names(self._stream.trackers)} are no markers of the set: name them in it, or choose "
            "another under Markers"
        )

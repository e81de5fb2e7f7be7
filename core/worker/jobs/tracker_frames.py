"""Job: turn another program's trackers, received over VMC, into marker frames."""

import math
import time

from ...formats.vmc.tracker_stream import TrackerStream
from ...formats.vmc.vmc_udp import Receiver
from ...markers.label_matching import join_names
from ..channel import Channel, open_when_free
from ..requests import TrackersRequest
from ..worker_settings import WORKER


def run(request: TrackersRequest, channel: Channel) -> None:
    """Send marker frames until STOP.

    Raises:
        PerfanimError: The port is taken, or the sender is unknown.
    """
    port, sender = request.source.port, request.source.sender
    stream, takes_place = TrackerStream(request.marker_set), request.after is not None
    with open_when_free(lambda: Receiver(port, sender), takes_place, channel.stop_requested) as receiver:
        channel.send_status(f"waiting for trackers on port {receiver.port}")
        silence, flood = _Silence(receiver, stream, sender, channel), _Flood(receiver, stream, channel)
        while not channel.stop_requested.is_set():
            packet = receiver.receive(WORKER.trackers_s)
            now_s = time.perf_counter()
            frames = stream.add(packet, now_s) if packet is not None else []
            flood.update(now_s)
            for frame in frames:
                if flood.has_room():
                    channel.send_frame(now_s, frame)
            silence.update(now_s, bool(frames))


class _Flood:
    """Warnings about a flood of packets: at its start, and at its end with the number of dropped packets.

    Without a limit, waiting frames would fill the memory and delay the poses.
    """

    def __init__(self, receiver: Receiver, stream: TrackerStream, channel: Channel) -> None:
        self._receiver, self._stream, self._channel = receiver, stream, channel
        self._is_on = False
        self._count, self._last_s = 0, -math.inf  # number of dropped packets, and when it last rose
        self._left_out = 0  # number of dropped frames
        self._reported = 0  # number of dropped packets and frames that has been reported

    def update(self, now_s: float) -> None:
        """Note new packets; warn when a flood begins or ends."""
        count = self._stream.gathering.flooding + self._receiver.overflowed
        if count > self._count:
            self._count, self._last_s = count, now_s
        was_on, self._is_on = self._is_on, now_s - self._last_s < WORKER.flood_s
        where = f"on port {self._receiver.port}"
        if self._is_on and not was_on:
            text = f"too many packets arrive {where}, most are dropped: let only one program send there"
            self._channel.send_warning(text)
        if was_on and not self._is_on:
            left_out = count + self._left_out
            self._channel.send_warning(f"{left_out - self._reported} excess packets {where} were dropped")
            self._reported = left_out

    def has_room(self) -> bool:
        """Return whether a frame may be sent; if not, count it as dropped."""
        if not self._is_on or self._channel.frames - self._channel.acknowledged < WORKER.flood_frames:
            return True
        self._left_out += 1
        return False


class _Silence:
    """Reports why no markers arrive, and when they are back."""

    def __init__(self, receiver: Receiver, stream: TrackerStream, sender: str, channel: Channel) -> None:
        self._receiver, self._stream, self._channel = receiver, stream, channel
        self._from = f" from {sender}" if sender else ""
        self._warning = ""
        self._hears = self._came = False
        self._others = 0
        self._since_s = time.perf_counter()

    def update(self, now_s: float, came: bool) -> None:
        """Report a change; `came` says whether markers have just arrived."""
        others = self._receiver.others
        if len(others) > self._others:
            named = f"packets to port {self._receiver.port} from {', '.join(others)} are ignored"
            self._channel.send_warning(f"{named}: close that program, or let it send to another port")
            self._others = len(others)
        if came:
            if self._warning:
                self._channel.send_warning("", standing=True)
            if self._warning and self._came:
                self._channel.send_warning(f"the trackers are back after {now_s - self._since_s:.1f} s")
            self._since_s, self._came, self._warning = now_s, True, ""
        elif not self._hears and self._stream.gathering.understood:
            # wait again, because only a complete set of packets shows what the program sends
            self._hears, self._since_s = True, now_s
        elif now_s - self._since_s > WORKER.silent_trackers_s:
            reason = self._reason()
            if reason != self._warning:
                self._warning = reason
                self._channel.send_warning(reason, standing=True)

    def _reason(self) -> str:
        where = f"on port {self._receiver.port}{self._from}"
        if self._came:
            return f"trackers no longer arrive {where}: the capture continues when they do"
        if not self._stream.gathering.packets and self._receiver.strangers:
            others = ", ".join(sorted(self._receiver.strangers))
            return f"nothing arrives {where}, only from {others}: choose the sender under Cameras"
        if not self._stream.gathering.packets:
            return f"nothing arrives {where}: let the other program send to this computer and port"
        if not self._stream.gathering.understood:
            return f"what arrives {where} is not VMC: choose this protocol in the other program"
        if not self._stream.trackers:
            return f"no trackers arrive {where}: let the other program send trackers, not only bones"
        return (
            f"no marker of the set is named like the trackers {join_names(self._stream.trackers)}: add these names to "
            "it, or choose another set under Markers"
        )

"""Sends a live capture's poses to another program over the VMC protocol."""

from collections.abc import Callable

from ..body.scene_pose import ScenePose
from ..body.skeleton import Skeleton
from ..errors import CaptureError
from ..formats.vmc.vmc_udp import Sender


class VmcSender:
    """Sends the first performer's poses.

    It runs in the solver process, through which every pose passes at the pace of the cameras, however slowly Blender
    draws. At the first failure it calls `warn` and stops sending; the capture continues.
    """

    def __init__(self, skeleton: Skeleton, host: str, port: int, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._sender: Sender | None = None
        try:
            self._sender = Sender(skeleton, host, port)
        except CaptureError as error:
            self._fail(error)

    def send(self, pose: ScenePose) -> None:
        """Send a pose; do nothing after a failure."""
        if self._sender is None:
            return
        try:
            performer = pose.performers[0]
            self._sender.send(pose.time_s, performer.rotations, performer.root_position_m)
        except CaptureError as error:
            self._sender.close()
            self._sender = None
            self._fail(error)

    def _fail(self, error: CaptureError) -> None:
        self._warn(f"nothing is sent over VMC: {error}")

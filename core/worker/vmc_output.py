"""Poses of a live capture sent to another program as they are shown, by the VMC protocol."""

from collections.abc import Callable, Sequence

from ..body.scene_pose import PerformerPose
from ..body.skeleton import Skeleton
from ..errors import CaptureError
from ..formats.vmc.link import Sender
from ..session.pose_filters import FilterSettings, PoseFilter


class BroadcastShaper(PoseFilter):
    """Shapes poses, and sends each to another program.

    Here, in the solver's process, every pose passes at the pace of the cameras, however slowly Blender draws. What the
    network does not take is told once, and then nothing is sent any more: a capture goes on without it.

    Args:
        skeleton, floor_m, shape, others: as of `PoseFilter`; only the first performer is sent.
        host, port: of the other program.
        tell: told what is wrong, in plain words.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        floor_m: float | None,
        shape: FilterSettings,
        host: str,
        port: int,
        tell: Callable[[str], None],
        others: Sequence[Skeleton] = (),
    ) -> None:
        super().__init__(skeleton, floor_m, shape, others)
        self._tell = tell
        self._sender: Sender | None = None
        try:
            self._sender = Sender(skeleton, host, port)
        except CaptureError as error:
            self._fail(error)

    def step(self, pose: PerformerPose) -> PerformerPose:
        """Return the next pose as it is shown, after it was sent."""
        shown = super().step(pose)
        if self._sender is not None:
            try:
                self._sender.send(shown.time_s, shown.rotations, shown.root_position_m)
            except CaptureError as error:
                self._sender.close()
                self._sender = None
                self._fail(error)
        return shown

    def _fail(self, error: CaptureError) -> None:
        self._tell(f"nothing is sent by VMC: {error}")

"""Client of a worker that is replaced if it dies or hangs."""

from collections.abc import Callable

from ..errors import CaptureError
from .client import WorkerClient
from .protocol import Message
from .restart_point import RestartPoint


class RestartingClient:
    """Polls a worker, and replaces it if that is allowed.

    The request for the new process has two additional keys, `after` and `cause`.

    Args:
        name: Name of the process in messages, such as "the solver process".
        on_restart: Called with the restart point and the cause before the new process starts.
    """

    def __init__(self, client: WorkerClient, name: str, on_restart: Callable[[RestartPoint, str], None]) -> None:
        self._client = client
        self._name = name
        self._on_restart = on_restart
        self._first: tuple[int, float] | None = None
        self._last = (0, 0.0, 0.0)

    def note_frame(self, number: int, time_s: float, stamp_s: float) -> None:
        """Note number, time and stamp of the last frame that arrived."""
        self._first = self._first or (number, time_s)
        self._last = (number, time_s, stamp_s)

    def poll(self) -> list[Message]:
        """Return the worker's messages; none if it has just been replaced.

        Raises:
            CaptureError: The worker died or hangs and must not be replaced.
        """
        try:
            return self._client.poll()
        except CaptureError as error:
            if self._first is None or not self._client.may_restart:
                raise
            cause = f"{self._name} {error.what}"
        number, time_s, stamp_s = self._last
        point = RestartPoint.after(self._first, (number, time_s), stamp_s)
        self._on_restart(point, cause)
        self._client.restart(point, cause)
        return []

"""When a worker counts as hung: by a clock that the test moves."""

import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.worker.liveness import Liveness
from perfanim.core.worker.protocol import Decoder, Message, MessageKind, encode_json
from perfanim.core.worker.worker_settings import WORKER

POLL_S = 0.05


class Watched:
    """A worker's signs of life, polled steadily."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.liveness = Liveness(lambda: self.now_s)

    def say(self, **content: float) -> None:
        """Poll once, with a frame or a sign of life."""
        data = Decoder().feed(encode_json(MessageKind.STATUS, content)) if content else [Message(MessageKind.FRAME)]
        self.liveness.update(data)
        self.liveness.check(connected=True)

    def silent_until_hung_s(self, connected: bool = True) -> float:
        """Poll until the worker counts as hung, and return how long that took."""
        since_s = self.now_s
        while True:
            self.now_s += POLL_S
            self.liveness.update([])
            try:
                self.liveness.check(connected)
            except CaptureError:
                return self.now_s - since_s


def test_a_worker_that_hangs_on_an_idle_machine_is_noticed_at_once() -> None:
    worker = Watched()
    worker.say()
    worker.say(stalled_s=0.0, slowness=1.0)
    assert worker.silent_until_hung_s() == pytest.approx(WORKER.hung_s, abs=2 * POLL_S)


@pytest.mark.parametrize("slowness", [2.0, 5.0])
def test_a_slow_worker_has_as_many_times_more_time(slowness: float) -> None:
    worker = Watched()
    worker.say()
    worker.say(stalled_s=0.0, slowness=slowness)
    assert worker.silent_until_hung_s() == pytest.approx(WORKER.hung_s * slowness, abs=2 * POLL_S)


def test_a_late_worker_that_still_says_something_is_left_alone() -> None:
    worker = Watched()
    worker.say()
    worker.say(stalled_s=0.0, slowness=5.0)
    for _ in range(100):
        for _ in range(100):  # five seconds each
            worker.now_s += POLL_S
            worker.liveness.update([])
            worker.liveness.check(connected=True)
        worker.say(stalled_s=5.0, slowness=5.0)


def test_a_slow_worker_that_hangs_is_noticed_in_the_end_and_one_on_a_machine_that_is_free_again_soon() -> None:
    worker = Watched()
    worker.say()
    worker.say(stalled_s=0.0, slowness=50.0)
    assert worker.silent_until_hung_s() == pytest.approx(WORKER.silence_s, abs=2 * POLL_S)
    worker.say(stalled_s=0.0, slowness=1.0)
    assert worker.silent_until_hung_s() == pytest.approx(WORKER.hung_s, abs=2 * POLL_S)


def test_no_progress_counts_like_silence() -> None:
    worker = Watched()
    worker.say()
    worker.say(stalled_s=2.0, slowness=3.0)
    with pytest.raises(CaptureError, match=r"made no progress for 2\.0 s"):
        worker.say(stalled_s=2.0, slowness=1.0)


def test_the_first_frame_may_take_longer() -> None:
    worker = Watched()
    worker.say(stalled_s=9.0, slowness=1.0)
    assert worker.silent_until_hung_s() == pytest.approx(WORKER.silence_s, abs=2 * POLL_S)
    assert Watched().silent_until_hung_s(connected=False) == pytest.approx(WORKER.start_s, abs=2 * POLL_S)


def test_silence_while_nobody_looked_hardly_counts() -> None:
    worker = Watched()
    worker.say()
    worker.now_s += 60.0
    worker.liveness.update([])
    worker.liveness.check(connected=True)

"""Where a capture sends the character to: nowhere until somebody switches it on."""

from dataclasses import astuple
from typing import Any

import bpy
import pytest


@pytest.fixture
def asked(part: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What the worker is asked for, without the files that a capture checks first."""
    setup = part("capture.capture_request")
    monkeypatch.setattr(setup.readiness, "database_frames", lambda path: 1)
    return lambda: setup.make(bpy.context.scene.perfanim).request.vmc


def test_it_is_off_at_first(asked: Any) -> None:
    assert not bpy.context.scene.perfanim_sending.on
    assert asked() is None


def test_switched_on_it_goes_to_host_and_port(asked: Any) -> None:
    chosen = bpy.context.scene.perfanim_sending
    chosen.on = True
    assert astuple(asked()) == ("127.0.0.1", 39539)
    chosen.host, chosen.port = " localhost ", 39600
    assert astuple(asked()) == ("localhost", 39600)


def test_without_online_access_only_this_computer_is_sent_to(asked: Any, part: Any, monkeypatch: Any) -> None:
    chosen, sending = bpy.context.scene.perfanim_sending, part("settings.vmc_settings")
    chosen.on, chosen.host = True, "192.168.1.20"
    for allowed in (False, True):
        monkeypatch.setattr(sending, "is_online_allowed", lambda allowed=allowed: allowed)
        assert (asked() and astuple(asked())) == (("192.168.1.20", 39539) if allowed else None)
        assert bool(sending.sending_problem(chosen)) != allowed
    monkeypatch.setattr(sending, "is_online_allowed", lambda: False)
    for host in ("127.0.0.1", "::1", "localhost"):
        chosen.host = host
        assert astuple(asked()) == (host, 39539)
    chosen.host = " "
    assert asked() is None

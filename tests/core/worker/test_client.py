import errno
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.worker import child_process
from perfanim.core.worker import client as client_module
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.connection import WorkerConnection
from perfanim.core.worker.protocol import Message, MessageKind
from perfanim.core.worker.worker_settings import WorkerSettings

PATIENCE_S = 60.0


@contextmanager
def worker(request: dict[str, Any]) -> Iterator[WorkerClient]:
    client = WorkerClient(request)
    try:
        yield client
    finally:
        client.close()


def collect(client: WorkerClient, until: Callable[[list[Message]], bool]) -> list[Message]:
    messages: list[Message] = []
    limit = time.monotonic() + PATIENCE_S
    while not until(messages):
        assert time.monotonic() < limit, [m.kind for m in messages]
        messages += client.poll()
        time.sleep(0.01)
    return messages


def test_an_unknown_job_is_an_error_message_then_the_end() -> None:
    with worker({"job": "nonsense"}) as client:
        messages = collect(client, lambda m: client.ended)
        wanted = [m for m in messages if m.kind is not MessageKind.STATUS]
        assert [m.kind for m in wanted] == [MessageKind.ERROR, MessageKind.END]
        assert "nonsense" in wanted[0].json()["what"]
        assert client.poll() == []


def test_poll_never_waits() -> None:
    with worker({"job": "nonsense"}) as client:
        started = time.perf_counter()
        client.poll()  # the process cannot have answered yet
        assert not client.ended
        assert time.perf_counter() - started < PATIENCE_S


def test_a_killed_worker_is_noticed() -> None:
    with worker({"job": "nonsense"}) as client:
        os.kill(client.process_id, getattr(signal, "SIGKILL", signal.SIGTERM))  # Windows has one way only
        with pytest.raises(CaptureError, match="ended unexpectedly"):
            collect(client, lambda m: False)


def test_the_systems_error_is_told() -> None:
    with worker({"job": "nonsense"}) as client:
        client.ask(None)
        connected = client._connection._socket
        client._connection._socket = SimpleNamespace(recv=reset, fileno=connected.fileno, close=connected.close)
        with pytest.raises(CaptureError, match=r"ended unexpectedly \(status \d+, Connection reset by peer\)"):
            collect(client, lambda m: False)


def reset(_: int) -> bytes:
    raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")


def test_messages_that_arrive_after_the_end_of_the_process_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a busy machine, where the system delivers them late."""
    receive, late = WorkerConnection.receive, [True, True]
    with worker({"job": "nonsense"}) as client:
        client.ask(None)
        while client.running:
            time.sleep(0.01)
        monkeypatch.setattr(WorkerConnection, "receive", lambda it: [] if late and late.pop() else receive(it))
        kinds = [message.kind for message in collect(client, lambda _: client.ended)]
        assert not late
        assert kinds[-2:] == [MessageKind.ERROR, MessageKind.END]


def test_a_worker_that_gets_no_further_may_be_replaced_but_not_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Message] = []
    with worker({"job": "nonsense"}) as client:
        collect(client, lambda m: bool(m))
        monkeypatch.setattr(WorkerConnection, "receive", lambda _: [said.pop(0)] if said else [])
        client.ended = False
        stalled = Message(MessageKind.STATUS, b'{"stalled_s": 2.0}')
        said += [stalled, Message(MessageKind.POSE), Message(MessageKind.STATUS, b'{"stalled_s": 0.4}')]
        for _ in range(3):  # before its first pose a worker may take its time
            client.poll()
        assert client.may_restart
        said.append(stalled)
        with pytest.raises(CaptureError, match=r"made no progress for 2.0 s"):
            client.poll()
        for _ in range(client_module.WORKER.restarts):
            assert client.may_restart  # also when the one that was started last has not worked yet
            client.restart()
        assert not client.may_restart
        monkeypatch.setattr(client_module, "WORKER", WorkerSettings(restarts_within_s=0.0))
        assert not client.may_restart  # none of three has worked, however long that took
        said.append(Message(MessageKind.POSE))
        client.poll()
        assert client.may_restart
        client.close()


def test_a_missing_interpreter_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="could not be started"):
        WorkerClient({"job": "nonsense"}, python=str(tmp_path / "no-python"))


def test_a_program_that_ends_before_it_is_told_what_to_do_is_named_and_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "no-python"
    program.write_text("#!/bin/sh\necho no such module >&2\nexit 7\n")
    program.chmod(0o755)
    # more than a pipe holds, so that the program is gone before all is written, on every machine
    monkeypatch.setattr(child_process, "library_paths", lambda: ["x" * 1_000_000])
    started: list[Any] = []
    popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1])
    with pytest.raises(CaptureError, match=r"no-python: could not be started \(ended immediately.*no such module"):
        WorkerClient({"job": "nonsense"}, python=str(program))
    assert [process.returncode is not None for process in started] == [True]


def test_a_stranger_on_the_port_is_refused() -> None:
    with worker({"job": "nonsense"}) as client:
        port = client._connection.port
        with socket.create_connection(("127.0.0.1", port)) as stranger:
            stranger.sendall(b"PA\x01\x0a\x02\x00\x00\x00{}")
            messages = collect(client, lambda m: client.ended)
            assert MessageKind.ERROR in [m.kind for m in messages]
            assert stranger.recv(1) == b""


def test_the_worker_ends_when_its_parent_is_gone() -> None:
    client = WorkerClient({"job": "nonsense"}, python=sys.executable)
    client.close(grace_s=PATIENCE_S)
    assert not client.running


@pytest.mark.skipif(sys.platform == "win32", reason="needs the C library's sleep")
def test_a_process_whose_interpreter_is_blocked_ends_by_itself() -> None:
    """Nothing written in Python can end it then, not even when who started it is gone."""
    program = (
        "import ctypes, sys\n"
        "from perfanim.core.worker import channel\n"
        "channel.WORKER = channel.WORKER.__class__(blocked_s=1.0)\n"
        "channel.Channel(int(sys.argv[1]), 'token')\n"
        "ctypes.PyDLL(None).sleep(3600)\n"  # keeps the interpreter's lock
    )
    with socket.create_server(("127.0.0.1", 0)) as listener:
        line = [sys.executable, "-c", program, str(listener.getsockname()[1])]
        process = subprocess.Popen(line, stderr=subprocess.PIPE)
        connection, _ = listener.accept()
        connection.close()
        _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert b"Timeout" in told

"""Files from a server on loopback that stalls, cuts, lies about lengths, redirects and changes its mind."""

import http.server
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.errors import DownloadError
from perfanim.core.system.download import DownloadSettings, check_address, download
from perfanim.core.system.progress import no_progress

BYTES = np.random.default_rng(0).bytes(300_000)
Answer = Callable[[Any, int], None]  # handler, number of the request


AT_ONCE = DownloadSettings(first_wait_s=0.001)


class Server(http.server.ThreadingHTTPServer):
    """Answers each request by `answer`, and notes from where on it was asked."""

    answer: Answer
    block_on_close = False

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.ranges: list[str | None] = []
        self.release = threading.Event()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/motion.zip"


class Handler(http.server.BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        self.server.ranges.append(self.headers.get("Range"))
        self.server.answer(self, len(self.server.ranges) - 1)
        self.close_connection = True

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as running:
        threading.Thread(target=running.serve_forever, args=(0.01,), daemon=True).start()
        yield running
        running.release.set()
        running.shutdown()


def send(
    handler: Any, stop: int | None = None, tag: str = '"a"', data: bytes = BYTES, length: int | None = None
) -> None:
    """Answer as a file server does, at most to the byte `stop`."""
    begin = handler.headers.get("Range")
    first = int(begin[6:-1]) if begin and handler.headers.get("If-Range") == tag else 0
    handler.send_response(206 if first else 200)
    if first:
        handler.send_header("Content-Range", f"bytes {first}-{len(data) - 1}/{len(data)}")
    if tag:
        handler.send_header("ETag", tag)
    handler.send_header("Content-Length", str(len(data) - first if length is None else length))
    handler.end_headers()
    handler.wfile.write(data[first:stop])


def got(server: Server, answer: Answer, target: Path, **more: Any) -> bytes:
    server.answer = answer
    return download(server.address, target, no_progress, replace(AT_ONCE, **more)).read_bytes()


def test_a_file_cut_a_hundred_times_has_the_same_bytes(server: Server, tmp_path: Path) -> None:
    places = np.sort(np.random.default_rng(1).choice(np.arange(1, len(BYTES)), 100, replace=False)).tolist()
    ends = [*places, None]
    assert got(server, lambda handler, number: send(handler, ends[number]), tmp_path / "a.zip") == BYTES
    assert len(server.ranges) == 101
    assert server.ranges[1:] == [f"bytes={place}-" for place in places]
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_what_came_is_kept_for_the_next_start(server: Server, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match=r"was interrupted .* resumes where it stopped"):
        got(server, lambda handler, number: send(handler, 100_000 if number == 0 else 0), tmp_path / "a.zip")
    assert not (tmp_path / "a.zip").exists()
    asked = len(server.ranges)
    assert got(server, lambda handler, number: send(handler), tmp_path / "a.zip") == BYTES
    assert server.ranges[asked:] == ["bytes=100000-"]


@pytest.mark.parametrize(
    "damage", ["", "{", "[]", '{"url": 1}', '{"url": "http://x/y.zip", "validator": "a", "total": 5}']
)
def test_a_part_with_damaged_facts_is_not_used(server: Server, tmp_path: Path, damage: str) -> None:
    (tmp_path / ".a.zip.part").write_bytes(b"x" * 1000)
    (tmp_path / ".a.zip.part.json").write_text(damage)
    assert got(server, lambda handler, number: send(handler), tmp_path / "a.zip") == BYTES
    assert server.ranges == [None]


def test_a_file_that_has_changed_meanwhile_begins_anew(server: Server, tmp_path: Path) -> None:
    other = BYTES[::-1]
    answers: list[Answer] = [
        lambda handler, _: send(handler, 50_000),
        lambda handler, _: send(handler, None, '"b"', other),
    ]
    assert got(server, lambda handler, number: answers[number](handler, number), tmp_path / "a.zip") == other


@pytest.mark.parametrize("tag", ["", 'W/"a"'])
def test_a_file_that_cannot_be_told_from_another_begins_anew(server: Server, tmp_path: Path, tag: str) -> None:
    ends = [50_000, None]
    assert got(server, lambda handler, number: send(handler, ends[number], tag), tmp_path / "a.zip") == BYTES
    assert server.ranges == [None, None]


def test_a_connection_that_stalls_is_made_again(server: Server, tmp_path: Path) -> None:
    def answer(handler: Any, number: int) -> None:
        send(handler, 70_000 if number == 0 else None)
        if number == 0:
            handler.wfile.flush()
            server.release.wait(20.0)

    assert got(server, answer, tmp_path / "a.zip", stalled_s=0.3) == BYTES
    assert server.ranges == [None, "bytes=70000-"]


def test_an_announced_length_that_never_comes_is_an_error(server: Server, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="300000 of 400000 bytes"):
        got(server, lambda handler, number: send(handler, tag="", length=400_000), tmp_path / "a.zip")


def test_no_more_than_the_announced_length_is_taken(server: Server, tmp_path: Path) -> None:
    assert got(server, lambda handler, number: send(handler, length=1000), tmp_path / "a.zip") == BYTES[:1000]


def test_a_file_without_a_length_ends_with_its_connection(server: Server, tmp_path: Path) -> None:
    def answer(handler: Any, number: int) -> None:
        handler.send_response(200)
        handler.end_headers()
        handler.wfile.write(BYTES)

    assert got(server, answer, tmp_path / "a.zip") == BYTES
    with pytest.raises(DownloadError, match="is larger than 1000 bytes"):
        got(server, answer, tmp_path / "b.zip", most_bytes=1000)


def test_a_file_too_large_is_refused_before_it_comes(server: Server, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="is larger than 1000 bytes"):
        got(server, lambda handler, number: send(handler), tmp_path / "a.zip", most_bytes=1000)
    with pytest.raises(DownloadError, match="MB of free space"):
        got(server, lambda handler, number: send(handler, 0, length=10**15 - 1), tmp_path / "b.zip", most_bytes=10**16)


@pytest.mark.parametrize("code", [500, 503, 429, 408])
def test_a_server_that_is_busy_is_asked_again(server: Server, tmp_path: Path, code: int) -> None:
    def answer(handler: Any, number: int) -> None:
        send(handler) if number == 2 else handler.send_error(code)

    assert got(server, answer, tmp_path / "a.zip") == BYTES


def test_a_file_that_is_not_there_is_not_asked_for_again(server: Server, tmp_path: Path) -> None:
    with pytest.raises(DownloadError, match="404"):
        got(server, lambda handler, number: handler.send_error(404), tmp_path / "a.zip")
    assert len(server.ranges) == 1


def redirect(where: str) -> Answer:
    def answer(handler: Any, number: int) -> None:
        handler.send_response(302)
        handler.send_header("Location", where)
        handler.end_headers()

    return answer


def test_redirects_stay_in_the_network(server: Server, tmp_path: Path) -> None:
    elsewhere = redirect(f"http://127.0.0.1:{server.server_port}/other")
    assert got(server, lambda h, number: elsewhere(h, 0) if number == 0 else send(h), tmp_path / "a.zip") == BYTES
    secret = tmp_path / "secret"
    secret.write_text("secret")
    for place in (secret.as_uri(), "ftp://127.0.0.1/a", "/motion.zip"):  # the last one for ever
        with pytest.raises(DownloadError):
            got(server, redirect(place), tmp_path / "b.zip")
        assert not (tmp_path / "b.zip").exists()


def test_nobody_answers(tmp_path: Path) -> None:
    with Server() as closed:
        address = closed.address
    with pytest.raises(DownloadError, match="was interrupted"):
        download(address, tmp_path / "a.zip", no_progress, AT_ONCE)


@pytest.mark.parametrize(
    "url", ["", "x", "file:///etc/passwd", "http://", "http://a/\n", "http://[::1", "ftp://a/b.zip", "http://a/b c"]
)
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(DownloadError, match="is not an http or https address"):
        check_address(url)

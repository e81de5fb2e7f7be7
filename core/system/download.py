"""Files from the network: resumed after a cut, never half under their name."""

import http.client
import json
import os
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit

from ..errors import DownloadError, shorten
from .files import writing
from .progress import Progress

_STALLED_S = 20.0  # without a byte, after which the connection counts as cut
_ATTEMPTS = 4  # in a row without a new byte
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 8.0  # between them
_PIECE = 1 << 18  # bytes
_MOST_BYTES = 64 << 30
_SPARE_BYTES = 256 << 20  # of the disk that stay free
_SCHEMES = ("http", "https")
_DISK_ADVICE = "free some space, or choose another folder"
_RESUME_ADVICE = "start it again: it goes on where it stopped"


@dataclass(frozen=True)
class _Part:
    """Facts of a file that is not whole yet.

    Args:
        validator: ETag or date of the server's file; without one nobody can tell whether it is still the same.
        total: bytes of the whole, -1 unknown.
    """

    url: str
    validator: str = ""
    total: int = -1


def check_address(url: str) -> None:
    """Raise DownloadError for anything but an http or https address."""
    try:
        parts = urlsplit(url)
        if parts.scheme in _SCHEMES and parts.hostname and url.isascii() and url.isprintable() and " " not in url:
            return
    except ValueError:
        pass
    raise DownloadError("is no http or https address", where=shorten(url, 100), advice="copy it from the browser")


def download(
    url: str, target: Path, progress: Progress, *, most_bytes: int = _MOST_BYTES, stalled_s: float = _STALLED_S
) -> Path:
    """Get a file from the network; return `target`.

    What came is kept beside `target` (`.NAME.part`) until it is whole, and the next call goes on from there if the
    server still has the same file.

    Args:
        most_bytes: a larger file is refused.
        stalled_s: without a byte, after which the connection is cut and made again.

    Raises:
        DownloadError: no such file, no connection, cut again and again, too large, no room on the disk.
        FormatError: the folder cannot be written.
    """
    check_address(url)
    part, facts = target.with_name(f".{target.name}.part"), target.with_name(f".{target.name}.part.json")
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        known = _read_facts(facts, url) if part.is_file() else _Part(url)
        if not known.validator:
            part.write_bytes(b"")
    failures, reason = 0, ""
    while True:
        had = part.stat().st_size
        if known.validator and had == known.total:
            break
        try:
            known = _fetch(known, part, facts, progress, most_bytes, stalled_s)
            if known.total in (-1, part.stat().st_size):  # a server that names no length ends when it is done
                break
            reason = f"ended after {part.stat().st_size} of {known.total} bytes"
        except (OSError, http.client.HTTPException) as error:
            reason, known = _reason(error), _read_facts(facts, url)
        # what cannot be resumed begins from nothing each time
        failures = 0 if known.validator and part.stat().st_size > had else failures + 1
        if failures >= _ATTEMPTS:
            raise DownloadError(f"was cut ({reason})", where=shorten(url, 100), advice=_RESUME_ADVICE)
        if failures:
            progress(_share(part, known.total), f"waiting for {urlsplit(url).hostname}: {reason}")
            time.sleep(min(_FIRST_WAIT_S * 2 ** (failures - 1), _LONGEST_WAIT_S))
    with writing(target):
        with part.open("r+b") as written:
            os.fsync(written.fileno())
        part.replace(target)
        facts.unlink(missing_ok=True)
    return target


def _fetch(known: _Part, part: Path, facts: Path, progress: Progress, most_bytes: int, stalled_s: float) -> _Part:
    """Get the missing bytes over one connection; return the facts of the file there."""
    had = part.stat().st_size if known.validator and part.stat().st_size < known.total else 0
    request = urllib.request.Request(known.url, headers={"User-Agent": "perfanim", "Accept-Encoding": "identity"})  # noqa: S310 - checked
    if had:
        request.add_header("Range", f"bytes={had}-")
        request.add_header("If-Range", known.validator)
    with _answer(request, known.url, stalled_s) as answer:
        resumed = answer.status == http.client.PARTIAL_CONTENT and _starts_at(answer, had)
        length = _length(answer)
        total = -1 if length is None else length + (had if resumed else 0)
        if total > most_bytes:
            raise DownloadError(
                f"has {total} bytes, {most_bytes} at most", where=shorten(known.url, 100), advice="get a smaller one"
            )
        facts_there = _Part(known.url, answer.headers.get("ETag") or answer.headers.get("Last-Modified") or "", total)
        if facts_there.validator.startswith("W/"):  # may be the same for other bytes
            facts_there = _Part(known.url, "", total)
        if resumed and facts_there.total != known.total:
            part.write_bytes(b"")
            raise ConnectionError("the file has changed meanwhile")
        with writing(part):
            free = shutil.disk_usage(part.parent).free
        if total - (had if resumed else 0) + _SPARE_BYTES > free:
            raise DownloadError(
                f"needs {total >> 20} MB, {free >> 20} MB are free", where=str(part.parent), advice="free some space"
            )
        with writing(part, _DISK_ADVICE):
            facts.write_text(json.dumps(asdict(facts_there)), encoding="utf-8")
        with part.open("r+b" if resumed else "wb") as file:
            file.seek(had if resumed else 0)
            _receive(answer.read1, file, total, most_bytes, lambda: _tell(progress, part, file.tell(), total))
    return facts_there


def _receive(
    read: Callable[[int], bytes], file: BinaryIO, total: int, most_bytes: int, tell: Callable[[], None]
) -> None:
    """Write pieces to a file as they come, no more than was announced."""
    limit = total if total >= 0 else most_bytes
    while piece := read(_PIECE):
        with writing(file.name, _DISK_ADVICE):
            file.write(piece[: limit - file.tell()])
            file.flush()
        tell()
        if file.tell() >= limit:
            if total < 0:
                raise DownloadError(f"has more than {most_bytes} bytes", advice="get a smaller one")
            return


@contextmanager
def _answer(request: urllib.request.Request, url: str, stalled_s: float) -> Iterator[Any]:
    """Yield the server's answer; DownloadError where no other attempt can help."""
    opener = urllib.request.build_opener(_Redirects)
    try:
        with opener.open(request, timeout=stalled_s) as answer:
            yield answer
    except urllib.error.HTTPError as error:
        if error.code in (http.client.REQUEST_TIMEOUT, http.client.TOO_MANY_REQUESTS) or error.code >= 500:
            raise ConnectionError(f"{error.code} {error.reason}") from error
        raise DownloadError(
            f"cannot be had ({error.code} {shorten(str(error.reason), 60)})",
            where=shorten(url, 100),
            advice="check the address",
        ) from error


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows other addresses of the network only, and none that gives up encryption."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        check_address(newurl)
        if urlsplit(req.full_url).scheme == "https" and urlsplit(newurl).scheme != "https":
            raise DownloadError("leads to an address without encryption", where=shorten(newurl, 100))
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _starts_at(answer: Any, had: int) -> bool:
    """Return whether a part of the file begins where ours ends."""
    return str(answer.headers.get("Content-Range", "")).startswith(f"bytes {had}-")


def _length(answer: Any) -> int | None:
    text = str(answer.headers.get("Content-Length", ""))
    return int(text) if text.isdecimal() and len(text) < 16 else None


def _read_facts(path: Path, url: str) -> _Part:
    """Return the facts of a part; of none where missing, damaged or of another."""
    with suppress(OSError, ValueError, TypeError):
        facts = _Part(**json.loads(path.read_text(encoding="utf-8")[:4096]))
        if (facts.url, type(facts.validator), type(facts.total)) == (url, str, int):
            return facts
    return _Part(url)


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return "nothing came"
    return shorten(str(getattr(error, "reason", "")) or str(error) or type(error).__name__, 80)


def _share(part: Path, total: int) -> float:
    return part.stat().st_size / total if total > 0 else 0.0


def _tell(progress: Progress, part: Path, had: int, total: int) -> None:
    megabytes = f"{had / 1e6:.0f} of {total / 1e6:.0f} MB" if total > 0 else f"{had / 1e6:.0f} MB"
    progress(had / total if total > 0 else 0.0, f"getting {part.name[1:-5]}: {megabytes}")

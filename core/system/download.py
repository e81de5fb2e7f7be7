"""Downloads that resume after an interruption and never leave an incomplete file under the final name."""

import http.client
import json
import os
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ..errors import DownloadError, shorten
from .files import writing
from .progress import Progress


@dataclass(frozen=True)
class DownloadSettings:
    """Limits of a download.

    Args:
        stalled_s: Time without data after which the connection counts as lost.
        attempts: Number of successive attempts without new data after which the download fails.
        first_wait_s: Wait before the second attempt; each further wait is twice as long.
        longest_wait_s: Longest wait between two attempts.
        most_bytes: Size above which a file is rejected.
        spare_bytes: Disk space that stays free.
    """

    stalled_s: float = 20.0
    attempts: int = 4
    first_wait_s: float = 0.5
    longest_wait_s: float = 8.0
    most_bytes: int = 64 << 30
    spare_bytes: int = 256 << 20


SETTINGS = DownloadSettings()


@dataclass(frozen=True)
class _Part:
    """State of a partial download.

    Args:
        validator: ETag or date of the server's file; "" if changes of the file cannot be detected.
        total: Size of the whole file in bytes, -1 if unknown.
    """

    url: str
    validator: str = ""
    total: int = -1


def check_address(url: str) -> None:
    """Raise DownloadError for anything but an http or https address."""
    with suppress(ValueError):
        parts = urlsplit(url)
        is_plain = url.isascii() and url.isprintable() and " " not in url
        if parts.scheme in ("http", "https") and parts.hostname and is_plain:
            return
    raise DownloadError("is not an http or https address", where=shorten(url, 100), advice="copy it from the browser")


def download(url: str, target: Path, progress: Progress, settings: DownloadSettings = SETTINGS) -> Path:
    """Download a file; return `target`.

    Received data is kept next to `target` (`.NAME.part`) until the file is complete. The next call continues that file
    if the server's file has not changed.

    Raises:
        DownloadError: The address is invalid or not found, the connection keeps failing, or the file is too large.
        FormatError: The folder cannot be written to.
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
            known = _fetch(known, part, facts, progress, settings)
            if known.total in (-1, part.stat().st_size):  # -1: the data ends with the connection
                break
            reason = f"ended after {part.stat().st_size} of {known.total} bytes"
        except (OSError, http.client.HTTPException) as error:
            reason, known = _reason(error), _read_facts(facts, url)
        # without a validator each attempt starts from scratch, so new bytes are no progress
        failures = 0 if known.validator and part.stat().st_size > had else failures + 1
        if failures >= settings.attempts:
            advice = "start the download again: it resumes where it stopped"
            raise DownloadError(f"was interrupted ({reason})", where=shorten(url, 100), advice=advice)
        if failures:
            waiting = f"waiting for {urlsplit(url).hostname}: {reason}"
            progress(part.stat().st_size / known.total if known.total > 0 else 0.0, waiting)
            time.sleep(min(settings.first_wait_s * 2 ** (failures - 1), settings.longest_wait_s))
    with writing(target):
        with part.open("r+b") as written:
            os.fsync(written.fileno())
        part.replace(target)
        facts.unlink(missing_ok=True)
    return target


def _fetch(known: _Part, part: Path, facts: Path, progress: Progress, settings: DownloadSettings) -> _Part:
    """Download the missing bytes over one connection; return the state of the download."""
    had = part.stat().st_size if known.validator and part.stat().st_size < known.total else 0
    request = urllib.request.Request(known.url, headers={"User-Agent": "perfanim", "Accept-Encoding": "identity"})  # noqa: S310 - checked
    if had:
        request.add_header("Range", f"bytes={had}-")
        request.add_header("If-Range", known.validator)
    with _answer(request, known.url, settings.stalled_s) as answer:
        is_part = str(answer.headers.get("Content-Range", "")).startswith(f"bytes {had}-")
        is_resumed = answer.status == http.client.PARTIAL_CONTENT and is_part
        start = had if is_resumed else 0
        length = _length(answer)
        total = -1 if length is None else start + length
        if total > settings.most_bytes:
            raise _too_large(known.url, settings)
        validator = answer.headers.get("ETag") or answer.headers.get("Last-Modified") or ""
        there = _Part(known.url, "" if validator.startswith("W/") else validator, total)  # weak ETag: bytes may differ
        if is_resumed and total != known.total:
            part.write_bytes(b"")
            raise ConnectionError("the file has changed in the meantime")
        with writing(part, "free some space, or choose another folder"):
            free = shutil.disk_usage(part.parent).free
            if total - start + settings.spare_bytes > free:
                what = f"has {free >> 20} MB of free space, but the download needs {total >> 20} MB"
                raise DownloadError(what, where=str(part.parent), advice="free some space")
            facts.write_text(json.dumps(asdict(there)), encoding="utf-8")
        with part.open("r+b" if is_resumed else "wb") as file:
            file.seek(start)
            _receive(answer, file, total, progress, settings)
    return there


def _receive(answer: Any, file: Any, total: int, progress: Progress, settings: DownloadSettings) -> None:
    """Write data to a file as it arrives, but no more than the announced length."""
    part, limit = Path(file.name), total if total >= 0 else settings.most_bytes
    while piece := answer.read1(1 << 18):
        with writing(part, "free some space, or choose another folder"):
            file.write(piece[: limit - file.tell()])
            file.flush()
        had = file.tell()
        of_all = f" of {total / 1e6:.0f}" if total > 0 else ""
        progress(had / total if total > 0 else 0.0, f"downloading {part.name[1:-5]}: {had / 1e6:.0f}{of_all} MB")
        if had >= limit:
            if total < 0:
                raise _too_large(answer.url, settings)
            return


def _too_large(url: str, settings: DownloadSettings) -> DownloadError:
    what = f"is larger than {settings.most_bytes} bytes"
    return DownloadError(what, where=shorten(url, 100), advice="choose a smaller file")


@contextmanager
def _answer(request: urllib.request.Request, url: str, stalled_s: float) -> Iterator[Any]:
    """Yield the server's response; raise DownloadError if another attempt cannot help."""
    opener = urllib.request.build_opener(_Redirects)
    try:
        with opener.open(request, timeout=stalled_s) as answer:
            yield answer
    except urllib.error.HTTPError as error:
        if error.code in (http.client.REQUEST_TIMEOUT, http.client.TOO_MANY_REQUESTS) or error.code >= 500:
            raise ConnectionError(f"{error.code} {error.reason}") from error
        what = f"cannot be downloaded ({error.code} {shorten(str(error.reason), 60)})"
        raise DownloadError(what, where=shorten(url, 100), advice="check the address") from error


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects to http and https addresses only, and never from https to http."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        check_address(newurl)
        if urlsplit(req.full_url).scheme == "https" and urlsplit(newurl).scheme != "https":
            raise DownloadError(
                "redirects to an unencrypted address", where=shorten(newurl, 100), advice="use another source"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _length(answer: Any) -> int | None:
    text = str(answer.headers.get("Content-Length", ""))
    return int(text) if text.isdecimal() and len(text) < 16 else None


def _read_facts(path: Path, url: str) -> _Part:
    """Return the stored state of a partial download; an empty one if it is missing, damaged or of another address."""
    with suppress(OSError, ValueError, TypeError):
        facts = _Part(**json.loads(path.read_text(encoding="utf-8")[:4096]))
        if (facts.url, type(facts.validator), type(facts.total)) == (url, str, int):
            return facts
    return _Part(url)


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return "no data arrived"
    return shorten(str(getattr(error, "reason", "")) or str(error) or type(error).__name__, 80)

"""File access: atomic writes, reads that check the file first, and TOML."""

import errno
import os
import re
import shutil
import stat
import tempfile
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, BinaryIO

import tomli_w

from ..errors import FormatError, PerfanimError, shorten
from .file_content import content_kind, decode_text
from .lock import is_locked
from .outputs import LOCK_ENDING, is_claimed, writer_lock
from .schema import Table, plain

SLACK_BYTES = 64 << 20  # memory that the content of any file may take, however small the file is
_MOST_TABLES = 30_000  # largest number of tables in a TOML file
_DEEPEST_TOML = 32  # largest nesting depth, and largest number of parts of a dotted key
# TOML strings and comments, even unterminated ones. Possessive quantifiers: one pass without backtracking.
_QUOTED = re.compile(
    r"""#[^\n]*+|\"{3}(?:[^"\\]|\\.?|"(?!""))*+"{0,5}|'{3}(?:[^']|'(?!''))*+'{0,5}"""
    r"""|"(?:[^"\\\n]|\\[^\n]?)*+"?|'[^'\n]*+'?""",
    re.DOTALL,
)
# the parser needs time and memory that grow with the square of the depth
_DEEP_KEY = re.compile(rf"(?:\.[\w \t-]*+){{{_DEEPEST_TOML}}}")
_LONG_WORD = re.compile(r"[\w+-]{1001}")  # the parser uses a hundred bytes per digit
_NUMBERS = re.compile(r"\[\s+((?:[\w.+-]+,\s+)+)\]")  # list of numbers, one per line
_LEFT_BEHIND_S = 3600.0  # age above which a temporary file counts as abandoned
_RANDOM_LETTERS = 8  # letters that `tempfile` adds to names
# `.NAME.RANDOM.EXTENSION`; folders have no extension. Words of eight letters do not count as random
_TEMPORARY = re.compile(r"\..*\.(?=[a-z]*[0-9_])[a-z0-9_]{8}(\.\w+)?", re.DOTALL)
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


@contextmanager
def atomic_path(target: Path | str) -> Iterator[Path]:
    """Yield a temporary path; on success flush it to the disk and rename it to `target`.

    A link stays a link: the file it points to is replaced. Temporary files of killed processes are removed.

    Raises:
        FormatError: The target cannot be written, or another program is writing to it.
    """
    target = Path(os.path.realpath(target)) if os.path.islink(target) else Path(target)  # noqa: PTH114 - as is_file
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    with nullcontext() if is_claimed(target) else writer_lock(target), _replacing(target) as temporary:
        yield temporary


@contextmanager
def _replacing(target: Path) -> Iterator[Path]:
    """Yield a temporary path next to `target`; on success flush it to the disk and rename it."""
    with writing(target):
        start, end = f".{target.stem}.", target.suffix
        # a target named ".glb", say: writers that do not find their extension append it
        if not end and target.name.startswith("."):
            start, end = ".", target.name
        remove_left_behind(target.parent, start, end)
        handle, name = tempfile.mkstemp(prefix=start, suffix=end, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with writing(target, "choose another name"):
            with temporary.open("r+b") as written:  # on Windows, only a file open for writing can be flushed
                os.fsync(written.fileno())
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            temporary.replace(target)
    except OSError as error:
        if error.errno not in _DISK_ERRORS:
            raise
        with writing(target, "free some space, or choose another folder"):
            raise
    finally:
        temporary.unlink(missing_ok=True)


def remove_left_behind(folder: Path, start: str, end: str = "", age_s: float = _LEFT_BEHIND_S) -> None:
    """Remove temporary files and folders that were last written more than `age_s` ago."""
    oldest_s = time.time() - age_s
    with os.scandir(folder) as entries:
        for entry in entries:
            random = entry.name[len(start) : len(entry.name) - len(end)]
            if entry.name == f"{start}{random}{end}" and len(random) == _RANDOM_LETTERS:
                _remove_old(entry, oldest_s)


def clean_folder(folder: Path | str) -> None:
    """Remove temporary files and locks of killed processes from one of our own folders.

    Files in use are kept, and so are new ones. In other folders, a file with such a name may be the user's.
    """
    oldest_s = time.time() - _LEFT_BEHIND_S
    with suppress(OSError), os.scandir(folder) as entries:  # the folder does not exist or cannot be read
        for entry in entries:
            is_lock = entry.name.startswith(".") and entry.name.endswith(LOCK_ENDING) and len(entry.name) > 6
            if _TEMPORARY.fullmatch(entry.name) or (is_lock and not is_locked(entry.path)):
                _remove_old(entry, oldest_s)


def _remove_old(entry: os.DirEntry[str], oldest_s: float) -> None:
    """Remove a file or folder that was last written before `oldest_s`, a Unix time; ignore links."""
    path = Path(entry.path)
    with suppress(OSError):  # another process may have removed it first
        if entry.is_symlink():
            return
        if path.is_dir():
            if max(each.stat().st_mtime for each in (path, *path.iterdir())) < oldest_s:
                shutil.rmtree(path)
        elif path.is_file() and path.stat().st_mtime < oldest_s:
            path.unlink()


@contextmanager
def writing(
    target: Path | str, advice: str = "choose a folder you may write to", kind: type[PerfanimError] = FormatError
) -> Iterator[None]:
    """Turn the block's OSError into an error of class `kind` that says that `target` cannot be written."""
    try:
        yield
    except OSError as error:
        raise kind(f"cannot be written ({error.strerror or error})", where=str(target), advice=advice) from error


def is_file(path: Path | str) -> bool:
    """Return whether a regular file exists; False for invalid names."""
    return os.path.isfile(path)  # noqa: PTH113 - pathlib's method raises for long names and unreadable folders


def is_folder(path: Path | str) -> bool:
    """Return whether a folder exists; False for invalid names."""
    return os.path.isdir(path)  # noqa: PTH112 - as above


def exists(path: Path | str) -> bool:
    """Return whether a file or folder exists; False for invalid names."""
    return os.path.exists(path)  # noqa: PTH110 - as above


def open_foreign(path: Path | str, kind: type[PerfanimError] = FormatError) -> BinaryIO:
    """Open a regular file for reading; raise `kind` for anything else."""
    try:
        if not stat.S_ISREG(Path(path).stat().st_mode):  # checked before opening: a pipe would wait for its other end
            raise OSError(errno.EINVAL, "it is a folder, a pipe or a device")
        return Path(path).open("rb")
    except (OSError, ValueError) as error:  # ValueError: the name contains NUL, or cannot be encoded
        raise _unreadable(path, error, kind) from error


def _unreadable(path: Path | str, error: Exception, kind: type[PerfanimError]) -> PerfanimError:
    return kind(f"cannot be read ({getattr(error, 'strerror', error)})", where=str(path), advice="check the path")


def is_over_budget(needed_bytes: int, file_bytes: int, most_times: int = 4) -> bool:
    """Return whether foreign content declares far more than its file can contain.

    Every reader calls this before it allocates the memory that a file declares.

    Args:
        needed_bytes: Memory that the content would need.
        file_bytes: Size of the file, 0 for a stream.
        most_times: Memory allowed per byte of the file, in addition to 64 MiB.
    """
    return needed_bytes > most_times * file_bytes + SLACK_BYTES


def read_bytes(path: Path | str, most: int = 8 << 30, kind: type[PerfanimError] = FormatError) -> bytes:
    """Return the content of a file; raise `kind` if it is unreadable or larger than `most` bytes."""
    with open_foreign(path, kind) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            if size > most:
                what = f"has {size} bytes, but at most {most} are allowed"
                raise kind(what, where=str(path), advice="split it into smaller files")
            return file.read()
        except OSError as error:
            raise _unreadable(path, error, kind) from error


@contextmanager
def reading(
    where: Path | str, kind: type[PerfanimError] = FormatError, advice: str = "check the file", what: str = "is damaged"
) -> Iterator[None]:
    """Turn any error that damaged content causes in a parser into one of class `kind`."""
    try:
        yield
    except Exception as error:
        if isinstance(error, kind) or (isinstance(error, PerfanimError) and error.where):
            raise
        raise kind(f"{what} ({str(error) or type(error).__name__})", where=str(where), advice=advice) from error


def read_toml(path: Path | str) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        FormatError: The file is missing, malformed, too large or too deep, or a number is not finite.
    """
    with reading(path, what="is not valid TOML"):
        data = read_bytes(path, 4 << 20)
        if kind := content_kind(data):
            raise ValueError(f"it is {kind}")
        text = decode_text(data, str(path), "TOML file")
        _check_toml_text(text)
        tables = tomllib.loads(text)
        for key, value in tables.items():
            _check_toml_value(key, value, _DEEPEST_TOML)
    return tables


def _check_toml_text(text: str) -> None:
    """Raise ValueError for a text that would cost the parser far more time or memory than its length suggests."""
    bare = _QUOTED.sub("", text)
    if _DEEP_KEY.search(bare):
        raise ValueError(f"nested more than {_DEEPEST_TOML} levels deep")
    if _LONG_WORD.search(bare):
        raise ValueError("a number or unquoted key has more than 1000 characters")
    # Python's parser uses a kilobyte for each table, decimal fraction or eight keys
    if sum(map(bare.count, ".[{")) + bare.count("=") // 8 > _MOST_TABLES:
        raise ValueError(f"more than {_MOST_TABLES} tables and decimal fractions")


def _check_toml_value(key: str, value: Any, levels: int) -> None:
    """Raise ValueError for values that no valid file contains."""
    if levels == 0:
        raise ValueError(f"nested more than {_DEEPEST_TOML} levels deep")
    if isinstance(value, int | float) and not abs(value) < 1e18:  # so that its square is finite in float32
        raise ValueError(f"a number in {shorten(key, 40)} is not finite, or too large")
    if isinstance(value, str) and "\0" in value:  # impossible in paths
        raise ValueError(f"a string in {shorten(key, 40)} contains NUL")
    if isinstance(value, dict):
        for name, item in value.items():
            _check_toml_value(name, item, levels - 1)
    elif isinstance(value, list):
        for item in value:
            _check_toml_value(key, item, levels - 1)


def write_toml(path: Path | str, tables: Table) -> None:
    """Write nested mappings, lists, arrays, strings, numbers and booleans as TOML."""
    text = _NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())[:-1]}]", tomli_w.dumps(plain(tables)))
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")

"""Files that are never half written, and TOML."""

import errno
import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import FormatError

_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


@contextmanager
def atomic_path(target: Path | str) -> Iterator[Path]:
    """Yield a temporary path; on success sync and rename it onto `target`.

    Raises:
        FormatError: the folder cannot be written, `target` is a folder, or the disk is full.
    """
    target = Path(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise _unwritable(target, error, "choose a folder you may write to") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        _finish(temporary, target)
    except OSError as error:
        if error.errno not in _DISK_ERRORS:
            raise
        raise _unwritable(target, error, "free some space, or choose another folder") from error
    finally:
        temporary.unlink(missing_ok=True)


def _finish(temporary: Path, target: Path) -> None:
    try:
        with temporary.open("r+b") as written:  # synced only if open for writing, on Windows
            os.fsync(written.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(target, error, "choose another name") from error


def _unwritable(target: Path, error: OSError, advice: str) -> FormatError:
    return FormatError(f"cannot be written ({error.strerror})", where=str(target), advice=advice)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def read_bytes(path: Path | str) -> bytes:
    """Return the content of a file; FormatError when it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FormatError(f"cannot be read ({error.strerror})", where=str(path), advice="check the path") from error


def read_toml(path: Path | str) -> dict[str, Any]:
    """Return the tables of a TOML file; FormatError when it is missing or malformed."""
    try:
        return tomllib.loads(read_bytes(path).decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FormatError(f"is not valid TOML ({error})", where=str(path)) from error


def write_toml(path: Path | str, tables: Mapping[str, Any]) -> None:
    """Write nested mappings, lists, strings, numbers and booleans as TOML."""
    text = "\n".join(_toml_lines(tables, "")) + "\n"
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _toml_lines(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
    nested: list[tuple[str, Any]] = []
    for key, value in table.items():
        if isinstance(value, Mapping) or _is_table_list(value):
            nested.append((key, value))
        else:
            yield f"{_toml_key(key)} = {_toml_value(value)}"
    for key, value in nested:
        name = f"{prefix}{_toml_key(key)}"
        if isinstance(value, Mapping):
            yield f"\n[{name}]"
            yield from _toml_lines(value, f"{name}.")
        else:
            for item in value:
                yield f"\n[[{name}]]"
                yield from _toml_lines(item, f"{name}.")


def _is_table_list(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(v, Mapping) for v in value)


def _toml_key(key: str) -> str:
    bare = key and all(c.isascii() and (c.isalnum() or c in "-_") for c in key)
    return key if bare else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        escaped = "".join(
            f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else "\\" + c if c in '"\\' else c for c in value
        )
        return f'"{escaped}"'
    if hasattr(value, "tolist"):
        return _toml_value(value.tolist())
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    raise TypeError(f"no TOML form for {type(value).__name__}")

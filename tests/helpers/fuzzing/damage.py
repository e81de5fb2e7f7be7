"""Hypothesis strategies that damage well-formed inputs: bytes, text, JSON, TOML, OSC packets.

An input is a sample and a list of edits; Hypothesis shrinks the list, so a failing input stays close to its sample.
"""

import json
import re
import struct
import tomllib
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import tomli_w
from hypothesis import strategies as st

LARGEST = 1 << 20  # bytes of an input
Damage: TypeAlias = Callable[[bytes], st.SearchStrategy[bytes]]

_NUMBERS = (
    *("nan", "inf", "-inf", "1e400", "1e-300", "1e30", "1e160", "0", "-1", "65536", "4294967296"),
    *("9" * 400, "9" * 5000),
)
_TEXTS = (
    *("", "x" * 300, "x" * 70_000, "\0", "\ud800", "²", "é", "\u2028", "\ufeff", "../..", "/dev/zero", "true", "null"),
    *("[]", "{}", "[[[[", '"', "'", "#", ",", ";", "=", "\t" * 3000, " " * 20_000, "{ " * 2000, "[" * 5000),
)
_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 2**31, 2**63, 10**400, 1e30, 1e308, 1e-300, float("nan"), float("inf"), 1e9),
    *("", "x" * 300, "\0", "²", "/dev/zero", "..", [], {}, [[]], [0] * 1000, {"a": {}}),
)
_WORDS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 62, (1 << 64) - 1)
_ODD_TEXT = tuple(text.encode("utf-8", "surrogatepass") for text in _NUMBERS + _TEXTS)
_SIZED = [(word & ((1 << 8 * width) - 1), width) for word in _WORDS for width in (1, 2, 4, 8)]
_ODD_BYTES = (
    *(word.to_bytes(width, "little") for word, width in _SIZED),
    *(word.to_bytes(width, "big") for word, width in _SIZED),
    *(struct.pack("<f", value) for value in (float("nan"), float("inf"), 1e30, -1e-30, 0.0)),
)
_TOKENS = re.compile(rb"[^\s,;=\[\]{}\"']+|[\s,;=\[\]{}\"']")
_KINDS = (*("replace", "insert", "delete", "repeat", "swap", "cut") * 8, "fill", "fill numbered")  # filling takes long

_places = st.one_of(st.integers(0, 63), st.integers(0, 1023), st.integers(0, LARGEST))  # headers are the tender parts
_lengths = st.sampled_from((1, 1, 1, 2, 4, 12, 64, 1024))
_Edit: TypeAlias = tuple[str, int, int, int, bytes]


def _edits(pieces: Sequence[bytes]) -> st.SearchStrategy[list[_Edit]]:
    """Return lists of edits: kind, place, length, another place, piece."""
    edit = st.tuples(st.sampled_from(_KINDS), _places, _lengths, _places, st.sampled_from(pieces))
    return st.lists(edit, min_size=1, max_size=4)


def _edited(parts: list[bytes], edits: list[_Edit]) -> bytes:
    """Return parts (bytes, tokens or lines) after the edits, joined."""
    for kind, place, length, other, piece in edits:
        at, other = place % (len(parts) + 1), other % (len(parts) + 1)
        chosen = parts[at : at + length]
        if kind == "replace":
            parts[at : at + max(len(piece) if max(map(len, chosen), default=0) == 1 else 1, 1)] = [piece]
        elif kind == "insert":
            parts[at:at] = [piece]
        elif kind == "delete":
            del parts[at : at + length]
        elif kind == "repeat":
            parts[at:at] = chosen * 50
        elif kind == "swap":
            parts[at : at + length], parts[other : other + length] = parts[other : other + length], chosen
        elif kind == "cut":
            del parts[at:]
        else:
            parts[at:at] = _filling(b"".join(chosen), sum(map(len, parts)), kind == "fill numbered")
    return b"".join(parts)[:LARGEST]


def _filling(part: bytes, used: int, numbered: bool) -> list[bytes]:
    """Return a part so often that an input is as large as allowed; its first word may be numbered, as keys differ."""
    times = max(LARGEST - used, 0) // (len(part) + 6)
    word = re.search(rb"\w+", part) if numbered else None
    if word is None:
        return [part] * times
    return [part[: word.end()] + b"%d" % number + part[word.end() :] for number in range(times)]


def mostly(usual: st.SearchStrategy[bytes], other: st.SearchStrategy[bytes]) -> st.SearchStrategy[bytes]:
    """Return the first strategy four times of five; `one_of` alone shares evenly between all that it nests."""
    return st.integers(0, 4).flatmap(lambda number: usual if number else other)


def damaged_bytes(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the sample with bytes, words and numbers changed, cut, repeated and inserted anywhere."""
    return _edits(_ODD_BYTES).map(lambda edits: _edited([bytes([byte]) for byte in sample], edits))


def damaged_text(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the sample with words or lines changed; some of the time its bytes."""
    words, lines = _TOKENS.findall(sample), sample.splitlines(keepends=True)
    by_words = _edits(_ODD_TEXT).map(lambda edits: _edited(list(words), edits))
    by_lines = _edits((b"\r", b"\n\n", b"\0\n")).map(lambda edits: _edited(list(lines), edits))
    return st.one_of(by_words, by_lines, damaged_bytes(sample))


@st.composite
def damaged_value(draw: st.DrawFn, value: Any) -> Any:
    """Return a nested value with one entry changed, removed, added, repeated or renamed."""
    keys = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    how = (
        draw(st.sampled_from(("inside", "inside", "inside", "replace", "delete", "rename", "repeat")))
        if keys
        else "replace"
    )
    if how == "replace":
        return draw(st.sampled_from(_VALUES))
    key = draw(st.sampled_from(keys))
    changed = dict(value) if isinstance(value, dict) else list(value)
    if how == "delete":
        del changed[key]
    elif how == "rename" and isinstance(changed, dict):
        changed[str(draw(st.sampled_from(_VALUES)))[:300]] = changed.pop(key)
    elif how == "repeat" and isinstance(changed, list):
        changed += [changed[key]] * draw(st.sampled_from((1, 100, LARGEST // (len(json.dumps(value)) + 9))))
    else:
        changed[key] = draw(damaged_value(value[key]))
    return changed


def damaged_json(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the sample with values and keys of its JSON changed; some of the time its text."""
    try:
        value = json.loads(sample)
    except (ValueError, RecursionError):  # a corpus may hold other text
        return damaged_text(sample)
    changed = damaged_value(value).map(lambda other: json.dumps(other).encode()[:LARGEST])
    return mostly(changed, damaged_text(sample))


def damaged_toml(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the sample with values and keys of its TOML changed, or its text."""
    try:
        value = tomllib.loads(sample.decode("utf-8"))
    except (ValueError, RecursionError):  # a corpus may hold other text
        return damaged_text(sample)
    return mostly(damaged_value(value).map(_toml), damaged_text(sample))


def _toml(value: Any) -> bytes:
    table = value if isinstance(value, dict) else {"value": value}
    try:
        return tomli_w.dumps(table).encode("utf-8", "surrogatepass")[:LARGEST]
    except (TypeError, ValueError):  # TOML has no null, and no whole numbers of 400 digits
        return json.dumps(value).encode()[:LARGEST]


@st.composite
def damaged_packet(draw: st.DrawFn, sample: bytes) -> bytes:
    """Return the sample nested, repeated and joined in OSC bundles, with long names, or with its bytes changed."""
    how = draw(st.sampled_from(("nest", "join", "name", "bytes")))
    if how == "nest":
        for _ in range(draw(st.sampled_from((1, 4, 5, 1000)))):
            sample = bundled(sample)
    elif how == "join":
        sample = bundled(*[sample] * draw(st.sampled_from((2, 20))))
    elif how == "name":
        name = b"x" * draw(st.sampled_from((4, 124, 128, 132, 40_000)))
        sample = sample.replace(b"Hips", name).replace(b"LHR-", name)
    if how == "bytes" or draw(st.booleans()):
        sample = draw(damaged_bytes(sample))
    return sample[:65_507]  # of a datagram


def bundled(*items: bytes) -> bytes:
    """Return the OSC bundle of messages and bundles."""
    return b"#bundle\0" + bytes(7) + b"\1" + b"".join(len(item).to_bytes(4, "big") + item for item in items)

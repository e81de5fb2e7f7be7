"""Changes of bytes, text, JSON, TOML and OSC packets.

Each depends on a random generator alone, so a seed repeats it.
"""

import json
import random
import re
import struct
import tomllib
from collections.abc import Callable, Sequence
from typing import Any

LARGEST = 1 << 20  # bytes of an input

Mutation = Callable[[random.Random, bytes], bytes]

_ODD_TEXT = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e400",
        "1e-300",
        "1e30",
        "1e160",
        "0",
        "-1",
        "65536",
        "4294967296",
        "9" * 400,
        "9" * 5000,
    ),
    *("", "x" * 300, "x" * 70_000, "\0", "\ud800", "²", "é", "\u2028", "\ufeff", "../..", "/dev/zero", "true", "null"),
    *("[]", "{}", "[[[[", '"', "'", "#", ",", ";", "=", "\t" * 3000, " " * 20_000, "{ " * 2000, "[" * 5000),
)
_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 2**31, 2**63, 10**400, 1e30, 1e308, 1e-300, float("nan"), float("inf"), 1e9),
    *("", "x" * 300, "\0", "²", "/dev/zero", "..", [], {}, [[]], [0] * 1000, {"a": {}}),
)
_WORDS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 62, (1 << 64) - 1)
_REALS = tuple(struct.pack("<f", value) for value in (float("nan"), float("inf"), 1e30, -1e-30, 0.0))
_LARGE = 0.01  # share of the inputs with one part repeated until they are as large as allowed
_JOINTS = (b"", b".", b".", b".", b",", b" ", b"\t", b"\n", b"].[", b"]\n[")
_TOKENS = re.compile(rb"[^\s,;=\[\]{}\"']+|[\s,;=\[\]{}\"']")


def change_bytes(chance: random.Random, data: bytes) -> bytes:
    """Change, cut, repeat and insert bytes, words and numbers anywhere."""
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 4, 16))):
        at = chance.randrange(min(len(changed), chance.choice((64, 1024, LARGEST))) or 1)
        kind = chance.randrange(7)
        size = chance.choice((1, 4, 64, 1024))
        if kind == 0 and changed:
            changed[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            width = chance.choice((1, 2, 4, 8))
            word = chance.choice(_WORDS) & ((1 << 8 * width) - 1)
            changed[at : at + width] = word.to_bytes(width, chance.choice(("little", "big")))
        elif kind == 2:
            changed[at : at + 4] = chance.choice(_REALS)
        elif kind == 3:
            del changed[at : at + size]
        elif kind == 4:
            changed[at:at] = changed[at : at + size] * chance.choice((1, 2, 100))
        elif kind == 5:
            changed[at:at] = chance.randbytes(size)
        else:
            del changed[at:]
    return bytes(changed[:LARGEST])


def change_text(chance: random.Random, data: bytes) -> bytes:
    """Change words and lines of a text; some of the time its bytes."""
    if chance.random() < 0.1:
        return change_bytes(chance, data)
    if chance.random() < _LARGE:
        return repeat_part(chance, data)
    for _ in range(chance.choice((1, 1, 2, 5))):
        data = (_change_words if chance.random() < 0.6 else _change_lines)(chance, data)[:LARGEST]
    return data


def repeat_part(chance: random.Random, data: bytes) -> bytes:
    """Repeat a line, some lines, a word or a column until an input is large.

    Lines and words may be numbered, as keys and names must differ.
    """
    lines = data.splitlines(keepends=True) or [b"\n"]
    at = chance.randrange(len(lines))
    kind = chance.randrange(3)
    if kind == 0:
        part = b"".join(lines[at : at + chance.choice((1, 1, 1, 2, 5, 12))])
        return _filled(chance, b"".join(lines[:at]), part, b"", b"".join(lines[at:]))
    if kind == 1:
        words = _TOKENS.findall(lines[at]) or [b"a"]
        word = chance.choice([index for index, word in enumerate(words) if word.strip()] or [0])
        before, after = b"".join(lines[:at] + words[:word]), b"".join(words[word:] + lines[at + 1 :])
        part = b"".join(words[word : word + chance.choice((1, 1, 2, 6))])
        return _filled(chance, before, part, chance.choice(_JOINTS), after)
    mark = chance.choice((b"\t", b",", b" "))
    times = (LARGEST - len(data)) // (sum(len(line) for line in lines[at:]) + 1) + 1
    column = chance.randrange(max(lines[at].count(mark), 1))
    return b"".join(_widened(line, mark, column, times) if row >= at else line for row, line in enumerate(lines))[
        :LARGEST
    ]


def _filled(chance: random.Random, before: bytes, part: bytes, joint: bytes, after: bytes) -> bytes:
    """Return the part again and again between two others, numbered or not."""
    times = max(LARGEST - len(before) - len(after), 0) // (len(part) + len(joint) + 1)
    word = re.search(rb"\w+", part) if chance.random() < 0.5 else None
    if word is None:
        return before + (part + joint) * times + after
    start, stop = part[: word.end()], part[word.end() :] + joint
    return (before + b"".join(start + b"%d" % number + stop for number in range(times)) + after)[:LARGEST]


def _widened(line: bytes, mark: bytes, column: int, times: int) -> bytes:
    """Return a line with one of its fields, or two, many times."""
    fields = line.split(mark)
    return mark.join((*fields[:column], *fields[column : column + 2] * times, *fields[column + 2 :]))


def _change_words(chance: random.Random, data: bytes) -> bytes:
    words = _TOKENS.findall(data)
    if not words:
        return chance.choice(_ODD_TEXT).encode("utf-8", "surrogatepass")
    at = chance.randrange(min(len(words), chance.choice((40, 400, LARGEST))))
    kind = chance.randrange(4)
    if kind == 0:
        words[at] = words[chance.randrange(len(words))]
    elif kind == 1:
        del words[at : at + chance.choice((1, 3, 30))]
    elif kind == 2:
        words[at:at] = _repeated(words[at : at + 6], chance.choice((1, 50)))
    else:
        words[at] = chance.choice(_ODD_TEXT).encode("utf-8", "surrogatepass")
    return b"".join(words)


def _repeated(parts: list[bytes], times: int) -> list[bytes]:
    """Return parts again and again, but no more bytes than an input may have."""
    return parts * min(times, LARGEST // (1 + sum(map(len, parts))) + 1)


def _change_lines(chance: random.Random, data: bytes) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    at, other = (chance.randrange(len(lines)) for _ in range(2))
    kind = chance.randrange(5)
    if kind == 0:
        del lines[at : at + chance.choice((1, 4, len(lines)))]
    elif kind == 1:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 2:
        lines[at:at] = _repeated([lines[at]], chance.choice((1, 10, 2000)))
    elif kind == 3:
        lines[at:at] = lines[min(at, other) : max(at, other)]
    else:
        lines[at] = lines[at].rstrip() + chance.choice((b"\r", b"", b" \n\n", b"\0\n"))
    return b"".join(lines)


def change_json(chance: random.Random, data: bytes) -> bytes:
    """Change values and keys of JSON; some of the time its text."""
    if chance.random() < 0.2:
        return change_text(chance, data)
    try:
        value = json.loads(data)
        if chance.random() < _LARGE:
            value = _enlarged(chance, value)
        for _ in range(chance.choice((1, 1, 2, 4))):
            value = change_value(chance, value)
        return json.dumps(value).encode()[:LARGEST]
    except (ValueError, RecursionError):  # a corpus may hold other text
        return change_text(chance, data)


def change_toml(chance: random.Random, data: bytes) -> bytes:
    """Change values and keys of TOML; half of the time its text."""
    if chance.random() < 0.5:
        return change_text(chance, data)
    try:
        value: Any = tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError):  # a corpus may hold other text
        return change_text(chance, data)
    for _ in range(chance.choice((1, 1, 2))):
        value = change_value(chance, value)
    rows = value.items() if isinstance(value, dict) else [("value", value)]
    text = "".join(f"{_inline(str(key))} = {_inline(item)}\n" for key, item in rows)
    return text.encode("utf-8", "surrogatepass")[:LARGEST]


def _inline(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_inline(str(key))} = {_inline(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, float):
        return repr(value)  # TOML, too, has nan and inf
    return '""' if value is None else json.dumps(value)


def change_value(chance: random.Random, value: Any) -> Any:
    """Return a nested value with one entry changed, removed, added or renamed."""
    keys: Sequence[Any] = (
        list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    )
    if not keys or chance.random() < 0.15:
        return chance.choice(_ODD_VALUES)
    key = chance.choice(keys)
    changed = dict(value) if isinstance(value, dict) else list(value)
    kind = chance.random()
    if kind < 0.1:
        del changed[key]
    elif kind < 0.2 and isinstance(changed, dict):
        changed[str(chance.choice(_ODD_VALUES))[:300]] = changed.pop(key)
    elif kind < 0.3 and isinstance(changed, list):
        changed += [changed[key]] * chance.choice((1, 100))
    else:
        changed[key] = change_value(chance, value[key])
    return changed


def _enlarged(chance: random.Random, value: Any) -> Any:
    """Return a nested value with one entry of a list or table many times."""
    if isinstance(value, dict | list) and value and chance.random() < 0.7:
        key = chance.choice(list(value) if isinstance(value, dict) else range(len(value)))
        changed = dict(value) if isinstance(value, dict) else list(value)
        changed[key] = _enlarged(chance, value[key])
        return changed
    times = LARGEST // (len(json.dumps(value)) + 9)
    return {f"{number}": value for number in range(times)} if chance.random() < 0.3 else [value] * times


def change_packet(chance: random.Random, data: bytes) -> bytes:
    """Nest, repeat and join OSC bundles, or change their bytes."""
    kind = chance.randrange(6)
    if kind == 0:
        for _ in range(chance.choice((1, 4, 5, 1000))):
            data = bundled(data)
    elif kind == 1:
        data = bundled(*[data] * chance.choice((2, 20)))
    elif kind == 2:
        name = b"x" * chance.choice((4, 124, 128, 132, 40_000))
        data = data.replace(b"Hips", name).replace(b"LHR-", name)
    if kind > 1 or chance.random() < 0.5:
        data = change_bytes(chance, data)
    return data[:65_507]  # of a datagram


def bundled(*items: bytes) -> bytes:
    """Return the OSC bundle of messages and bundles."""
    return b"#bundle\0" + bytes(7) + b"\1" + b"".join(len(item).to_bytes(4, "big") + item for item in items)

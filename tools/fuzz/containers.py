"""Changes inside files with checksums.

Checksums and lengths are made right again, so that readers go on to the content.
"""

import hashlib
import io
import json
import random
import struct
import tarfile
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from typing import Any

from .mutations import LARGEST, change_bytes, change_json, change_text

_CHUNK = struct.Struct("<4sHHIII")  # of a take file: magic, kind, 0, sequence number, bytes and CRC-32 of the payload
_CHUNK_MAGIC = b"\x89PFC"
_TAKE_PREAMBLE = 20
_DATABASE = struct.Struct("<12sIQQ32s")  # magic, version, bytes of header and file, SHA-256 of the header
_JSON_CHUNKS: dict[int, dict[str, Any]] = {  # set-up, event, notes; with facts that few takes have
    1: {},
    4: {"gap": {"after": 3, "seconds": 0.5}},
    5: {"recorded": [1, 4], "filters": {"smoothing_s": 0.1}},
}
_END = 6  # bytes of its facts, these as JSON, rows of the index, trailer
_ROW = struct.Struct("<HHIQ")  # kind, 0, sequence number, offset of each chunk
_TRAILER = struct.Struct("<Q8s")  # offset of the last chunk, magic

_FEW = 100
_Files = list[tuple[str, bytes]]  # names and contents of an archive


def change_zip(chance: random.Random, data: bytes) -> bytes:
    """Change a file in an archive, its name or packing; sometimes all bytes."""
    if chance.random() < 0.3:
        return change_bytes(chance, data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = _change_files(chance, [(name, archive.read(name)) for name in archive.namelist()])
    packed = io.BytesIO()
    packings = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)
    packing = chance.choice(packings[: 3 if len(files) < _FEW else 2])  # the last takes milliseconds to begin a file
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(packed, "w", packing) as archive:  # names twice
        for name, content in files:
            archive.writestr(name, content)
    return packed.getvalue()[:LARGEST]


def change_tar(chance: random.Random, data: bytes) -> bytes:
    """Change a file in an archive, its name, kind or packing; sometimes all bytes."""
    if chance.random() < 0.3:
        return change_bytes(chance, data)
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        contents = {member.name: archive.extractfile(member) for member in archive}
        files = _change_files(chance, [(name, file.read()) for name, file in contents.items() if file])
    packed = io.BytesIO()
    layout = chance.choice((tarfile.GNU_FORMAT, tarfile.PAX_FORMAT))
    odd = chance.randrange(len(files) + 1)
    with tarfile.open(fileobj=packed, mode="w:gz", format=layout) as changed:
        for number, (name, content) in enumerate(files):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            if number == odd:
                member.type, member.linkname = chance.choice((tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE)), ".."
            changed.addfile(member, io.BytesIO(content))
    return packed.getvalue()[:LARGEST]


def _change_files(chance: random.Random, files: _Files) -> _Files:
    """Return the files with one changed, renamed, left out, or many times."""
    at = chance.randrange(len(files))
    name, content = files[at]
    kind = chance.randrange(6)
    if kind == 0:
        files[at] = (chance.choice(("../" + name, "/" + name, "x" * 300 + name, files[0][0], "a\\" + name)), content)
    elif kind == 1 and len(files) > 1:
        del files[at]
    elif kind == 2:  # first a header, as of an array
        files[at] = (name, change_text(chance, content[:128]) + content[128:])
    elif kind == 3 and chance.random() < 0.1:
        content = chance.choice((b"", content))
        times = min(chance.choice((100, 5000, 20_000)), LARGEST // (len(content) + 1))
        files += [(f"{number}/{number}{name}", content) for number in range(times)]
    elif kind == 4:
        files[at] = (name, change_text(chance, content))
    else:
        files[at] = (name, change_bytes(chance, content))
    return files


def change_take(chance: random.Random, data: bytes) -> bytes:
    """Change, remove and swap chunks of a take file; sometimes its bytes."""
    chunks = list(_chunks(data))
    if not chunks or chance.random() < 0.2:
        return change_bytes(chance, data)
    at, other = (chance.randrange(len(chunks)) for _ in range(2))
    number, sequence, payload = chunks[at]
    kind = chance.randrange(7)
    if kind == 0:
        del chunks[at]
    elif kind == 1:
        chunks[at], chunks[other] = chunks[other], chunks[at]
    elif kind == 2:
        chunks[at] = (chance.randrange(9), chance.choice((sequence, 0, 0xFFFFFFFF)), payload)
    elif number == _END:
        chunks[at] = (number, sequence, change_end(chance, payload))
    elif number in _JSON_CHUNKS:
        chunks[at] = (number, sequence, change_json(chance, _filled_up(chance, payload, _JSON_CHUNKS[number])))
    else:
        chunks[at] = (number, sequence, change_bytes(chance, payload))
    rest = _joined(chunks) if chance.random() < 0.8 else b"".join(_chunk(*chunk) for chunk in chunks)
    return (data[:_TAKE_PREAMBLE] + rest)[:LARGEST]


def _filled_up(chance: random.Random, payload: bytes, rare: dict[str, Any]) -> bytes:
    """Return a JSON object, half of the time with facts that few takes have."""
    try:
        facts = json.loads(payload)
    except (ValueError, RecursionError):  # a corpus may hold other text
        return payload
    if not isinstance(facts, dict) or not rare or chance.random() < 0.5:
        return payload
    return json.dumps(facts | rare).encode()


def change_end(chance: random.Random, payload: bytes) -> bytes:
    """Change the facts of a take's end mark; sometimes its bytes."""
    if chance.random() < 0.2:
        return change_bytes(chance, payload)
    stop = 4 + int.from_bytes(payload[:4], "little")
    facts = change_json(chance, payload[4:stop])
    return len(facts).to_bytes(4, "little") + facts + payload[stop:]


def _joined(chunks: list[tuple[int, int, bytes]]) -> bytes:
    """Return chunks as bytes; an end mark has the places of those before it."""
    rows, rest = b"", b""
    for number, sequence, payload in chunks:
        at = _TAKE_PREAMBLE + len(rest)
        rows += _ROW.pack(number, 0, sequence, at)
        stop = 4 + int.from_bytes(payload[:4], "little")
        if number == _END and stop + _TRAILER.size <= len(payload):
            payload = payload[:stop] + rows + _TRAILER.pack(at, payload[-8:])
        rest += _chunk(number, sequence, payload)
    return rest


def _chunks(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield kind, sequence number and payload of the intact chunks of a take."""
    at = _TAKE_PREAMBLE
    while at + _CHUNK.size < len(data) and data.startswith(_CHUNK_MAGIC, at):
        _, kind, _, sequence, size, _ = _CHUNK.unpack_from(data, at)
        at += _CHUNK.size + 4
        yield kind, sequence, data[at : at + size]
        at += size


def _chunk(kind: int, sequence: int, payload: bytes) -> bytes:
    head = _CHUNK.pack(_CHUNK_MAGIC, kind, 0, sequence, len(payload), zlib.crc32(payload))
    return head + zlib.crc32(head).to_bytes(4, "little") + payload


def change_database(chance: random.Random, data: bytes) -> bytes:
    """Change facts of a database's header; sometimes its bytes."""
    if chance.random() < 0.3:
        return change_bytes(chance, data)
    magic, version, header_bytes, _, _ = _DATABASE.unpack_from(data)
    stop = _DATABASE.size + header_bytes
    header = change_json(chance, data[_DATABASE.size : stop])
    start = _DATABASE.size + len(header)
    rest = header + bytes(-start % 64) + data[stop + -stop % 64 :]
    digest = hashlib.sha256(header).digest()
    return _DATABASE.pack(magic, version, len(header), _DATABASE.size + len(rest), digest) + rest

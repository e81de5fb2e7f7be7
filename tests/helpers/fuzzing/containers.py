"""Damage inside files with checksums.

Checksums and lengths are made right again, so that readers go on to the content.
"""

import hashlib
import io
import json
import struct
import tarfile
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

from .damage import LARGEST, damaged_bytes, damaged_json, damaged_text, mostly

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


@st.composite
def _damaged_zip(draw: st.DrawFn, sample: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(sample)) as archive:
        files = draw(_damaged_files([(name, archive.read(name)) for name in archive.namelist()]))
    packings = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)
    packing = draw(st.sampled_from(packings[: 3 if len(files) < _FEW else 2]))  # LZMA takes milliseconds a file
    packed = io.BytesIO()
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(packed, "w", packing) as archive:  # names twice
        for name, content in files:
            archive.writestr(name, content)
    return packed.getvalue()[:LARGEST]


def damaged_zip(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the archive with a file in it, its name or packing changed; sometimes its bytes."""
    return mostly(_damaged_zip(sample), damaged_bytes(sample))


@st.composite
def _damaged_tar(draw: st.DrawFn, sample: bytes) -> bytes:
    with tarfile.open(fileobj=io.BytesIO(sample)) as archive:
        contents = {member.name: archive.extractfile(member) for member in archive}
        files = draw(_damaged_files([(name, file.read()) for name, file in contents.items() if file]))
    odd = draw(st.integers(0, len(files)))
    packed = io.BytesIO()
    layout = draw(st.sampled_from((tarfile.GNU_FORMAT, tarfile.PAX_FORMAT)))
    with tarfile.open(fileobj=packed, mode="w:gz", format=layout) as changed:
        for number, (name, content) in enumerate(files):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            if number == odd:
                member.type = draw(st.sampled_from((tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE)))
                member.linkname = ".."
            changed.addfile(member, io.BytesIO(content))
    return packed.getvalue()[:LARGEST]


def damaged_tar(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the archive with a file in it, its name, kind or packing changed; sometimes its bytes."""
    return mostly(_damaged_tar(sample), damaged_bytes(sample))


@st.composite
def _damaged_files(draw: st.DrawFn, files: _Files) -> _Files:
    """Return the files with one changed, renamed, left out, or many times."""
    at = draw(st.integers(0, len(files) - 1))
    name, content = files[at]
    how = draw(st.sampled_from(("name", "leave out", "header", "many", "text", "bytes")))
    if how == "name":
        names = ("../" + name, "/" + name, "x" * 300 + name, files[0][0], "a\\" + name)
        files[at] = (draw(st.sampled_from(names)), content)
    elif how == "leave out" and len(files) > 1:
        del files[at]
    elif how == "header":  # as of an array
        files[at] = (name, draw(damaged_text(content[:128])) + content[128:])
    elif how == "many":
        content = draw(st.sampled_from((b"", content)))
        times = min(draw(st.sampled_from((100, 100, 100, 5000, 20_000))), LARGEST // (len(content) + 1))
        files += [(f"{number}/{number}{name}", content) for number in range(times)]
    else:
        files[at] = (name, draw((damaged_text if how == "text" else damaged_bytes)(content)))
    return files


@st.composite
def _damaged_chunks(draw: st.DrawFn, sample: bytes) -> bytes:
    chunks = list(_chunks(sample))
    facts = [place for place, (kind, _, _) in enumerate(chunks) if kind in _JSON_CHUNKS or kind == _END]
    at, other = draw(st.sampled_from((*facts, *range(len(chunks))))), draw(st.integers(0, len(chunks) - 1))
    number, sequence, payload = chunks[at]
    how = draw(st.sampled_from(("leave out", "swap", "mark", "content", "content", "content", "content")))
    if how == "leave out":
        del chunks[at]
    elif how == "swap":
        chunks[at], chunks[other] = chunks[other], chunks[at]
    elif how == "mark":
        marked = draw(st.integers(0, 8)), draw(st.sampled_from((sequence, 0, 0xFFFFFFFF)))
        chunks[at] = (*marked, payload)
    elif number == _END:
        chunks[at] = (number, sequence, draw(damaged_end(payload)))
    elif number in _JSON_CHUNKS:
        described = _with_rare_facts(payload, _JSON_CHUNKS[number]) if draw(st.booleans()) else payload
        chunks[at] = (number, sequence, draw(damaged_json(described)))
    else:
        chunks[at] = (number, sequence, draw(damaged_bytes(payload)))
    kept = b"".join(_chunk(*chunk) for chunk in chunks) if draw(st.integers(0, 4)) == 0 else _joined(chunks)
    return (sample[:_TAKE_PREAMBLE] + kept)[:LARGEST]


def damaged_take(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the take with chunks changed, removed or swapped; sometimes its bytes."""
    return mostly(_damaged_chunks(sample), damaged_bytes(sample)) if any(_chunks(sample)) else damaged_bytes(sample)


def _with_rare_facts(payload: bytes, rare: dict[str, Any]) -> bytes:
    """Return a JSON object with facts that few takes have."""
    try:
        facts = json.loads(payload)
    except (ValueError, RecursionError):  # a corpus may hold other text
        return payload
    return json.dumps(facts | rare).encode() if isinstance(facts, dict) else payload


@st.composite
def _damaged_facts(draw: st.DrawFn, payload: bytes) -> bytes:
    stop = 4 + int.from_bytes(payload[:4], "little")
    facts = draw(damaged_json(payload[4:stop]))
    return len(facts).to_bytes(4, "little") + facts + payload[stop:]


def damaged_end(payload: bytes) -> st.SearchStrategy[bytes]:
    """Return a take's end mark with its facts changed; sometimes its bytes."""
    return mostly(_damaged_facts(payload), damaged_bytes(payload))


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


@st.composite
def _damaged_header(draw: st.DrawFn, sample: bytes) -> bytes:
    magic, version, header_bytes, _, _ = _DATABASE.unpack_from(sample)
    stop = _DATABASE.size + header_bytes
    header = draw(damaged_json(sample[_DATABASE.size : stop]))
    start = _DATABASE.size + len(header)
    rest = header + bytes(-start % 64) + sample[stop + -stop % 64 :]
    digest = hashlib.sha256(header).digest()
    return _DATABASE.pack(magic, version, len(header), _DATABASE.size + len(rest), digest) + rest


def damaged_database(sample: bytes) -> st.SearchStrategy[bytes]:
    """Return the database with facts of its header changed; sometimes its bytes."""
    return mostly(_damaged_header(sample), damaged_bytes(sample))

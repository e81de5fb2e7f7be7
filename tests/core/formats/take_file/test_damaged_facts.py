"""Damaged facts with right checksums are a fault; the frames stay."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from perfanim.core.cli.main import main
from perfanim.core.errors import MOST_TEXT, TakeError
from perfanim.core.formats.take_file.append_notes import append_notes
from perfanim.core.formats.take_file.chunks import ChunkKind, encode_chunk, preamble, scan
from perfanim.core.formats.take_file.footer import Footer, RecordingFacts, duration_s, find_footer
from perfanim.core.formats.take_file.take_reader import Gap, read_take_file, summarise
from perfanim.core.formats.take_file.take_recovery import recover
from perfanim.core.formats.take_file.take_setup import TakeEvent, TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import take_facts, write_chunks, write_whole_take
from perfanim.core.markers.marker_frame import MarkerFrame
from records import frame_record, frames_of

Write = Callable[..., Path]

DEEP = b"[" * 3000
NESTED = b'{"filters": {"a": ' + b"[" * 400 + b"]" * 400 + b"}}"  # Python reads it, but cannot copy it
ENDS = [
    *(DEEP, b"[]", b"[[1]]", b'"a"', b"\xff", b"9" * 5000, NESTED),
    *(b'{"frames": Infinity}', b'{"frames": []}', b'{"frames": NaN}', b'{"frames": "x"}', b'{"frames": -1}'),
    *(b'{"frames": 1.5}', b'{"duration_s": []}', b'{"duration_s": 1e999}', b'{"frames": 1' + b"0" * 400 + b"}"),
]
NOTES = [
    *(DEEP, b"[]", NESTED, b'{"name": [[1]]}', b'{"recorded": 5}', b'{"recorded": [1]}', b'{"recorded": [[], 1]}'),
    *(b'{"recorded": ["x", 1]}', b'{"recorded": [Infinity, 1]}', b'{"recorded": [1, NaN]}', b'{"recorded": [1, null]}'),
]
EVENTS = [
    *(DEEP, b"[]", NESTED, b'{"gap": 5}', b'{"text": []}', b'{"gap": {"after": "x"}}', b'{"gap": {"after": Infinity}}'),
    *(b'{"gap": {"after": []}}', b'{"gap": {"seconds": "x"}}', b'{"gap": {"seconds": NaN}}'),
]
CASES = [
    *((ChunkKind.END, facts) for facts in ENDS),
    *((ChunkKind.NOTES, facts) for facts in NOTES),
    *((ChunkKind.EVENT, facts) for facts in EVENTS),
]


def _named(value: object) -> str:
    return value.name if isinstance(value, ChunkKind) else repr(value)[:40]


def _with(path: Path, kind: ChunkKind, facts: bytes) -> None:
    """Write these facts into a take, where a reader finds them; the rest is right."""
    chunks = [(chunk.kind, bytes(chunk.payload)) for chunk in scan(path.read_bytes(), "")[0]][:-1]
    if kind != ChunkKind.END:
        chunks.append((int(kind), facts))
        return write_chunks(path, chunks, take_facts(read_take_file(path).frames, 12))
    data, index = preamble(), []
    for number, (each, payload) in enumerate(chunks):
        index.append((each, len(data)))
        data += encode_chunk(each, number, payload)
    index.append((int(kind), len(data)))
    whole = Footer(RecordingFacts(), tuple(index)).pack()
    path.write_bytes(data + encode_chunk(kind, len(chunks), len(facts).to_bytes(4, "little") + facts + whole[6:]))
    return None


@pytest.mark.parametrize(("kind", "facts"), CASES, ids=_named)
def test_damaged_facts_are_a_fault_and_cost_no_frame(
    tmp_path: Path, write: Write, kind: ChunkKind, facts: bytes
) -> None:
    path = write(tmp_path / "a.perftake")
    _with(path, kind, facts)
    take = read_take_file(path)
    (fault,) = take.faults
    assert fault.what.startswith(
        f"chunk {len(take.chunks) - (kind != ChunkKind.END)} ({kind.name.lower()}) is unreadable: "
    )
    assert len(str(fault)) <= MOST_TEXT and str(fault).isprintable()
    assert (take.complete, take.ended) == (False, kind != ChunkKind.END)
    assert take.problems[0].startswith(str(fault))
    assert (take.notes, take.events, take.gaps) == (TakeNotes("Walk 1"), (), ())
    assert frames_of(take) == [frame_record(number) for number in range(12)]
    assert len(take.recorded_poses) == take.declared_frames == 12
    assert summarise(path).complete is (kind != ChunkKind.END)
    recover(take, tmp_path / "b.perftake")
    whole = read_take_file(tmp_path / "b.perftake")
    assert whole.complete and summarise(whole.path).frames == 12
    assert frames_of(whole) == frames_of(take)
    assert main(["take", "info", str(path), "--json"]) == 0


@pytest.mark.parametrize(("kind", "facts"), CASES, ids=_named)
def test_damaged_facts_alone_are_refused_with_their_place(kind: ChunkKind, facts: bytes) -> None:
    read = {ChunkKind.NOTES: TakeNotes.from_json, ChunkKind.EVENT: TakeEvent.from_json, ChunkKind.END: Footer.unpack}[
        kind
    ]
    payload = facts
    if kind == ChunkKind.END:
        payload = len(facts).to_bytes(4, "little") + facts + Footer(RecordingFacts(), ((6, 20),)).pack()[6:]
    with pytest.raises(TakeError) as refused:
        read(payload, "a.perftake")
    assert refused.value.where.startswith("a.perftake") and refused.value.advice
    assert len(str(refused.value)) <= MOST_TEXT and str(refused.value).isprintable()
    with pytest.raises(TakeError, match=r"a\.perftake: "):
        read(b"\0", "a.perftake")


def test_a_take_with_a_damaged_end_mark_is_listed_as_cut_off(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path / "a.perftake")
    _with(path, ChunkKind.END, DEEP)
    with path.open("rb") as file:
        assert find_footer(file) is None
    assert summarise(path).notes.name == "a"
    with pytest.raises(TakeError, match="was cut off; recover the take first"):
        append_notes(path, TakeNotes("x"))


def test_facts_that_are_left_out_or_null_have_their_defaults(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path / "a.perftake")
    _with(path, ChunkKind.END, b'{"frames": null, "weather": "fine"}')
    assert read_take_file(path).declared_frames == summarise(path).frames == 0
    _with(path, ChunkKind.EVENT, b'{"text": "lost", "gap": {"after": null}}')
    assert read_take_file(path).gaps == (Gap(-1, 0.0, "lost"),)
    known = TakeNotes.from_json(b'{"name": null, "recorded": [2, 5], "rating": "x"}', "")
    assert known == TakeNotes(recorded=(2, 5))


def test_a_setup_nested_beyond_all_use_is_refused(setup: TakeSetup) -> None:
    deep: object = []
    for _ in range(400):
        deep = [deep]
    facts = json.loads(setup.to_json()) | {"capture": {"a": deep}}
    with pytest.raises(TakeError, match="nested more than 64 deep"):
        TakeSetup.from_json(json.dumps(facts).encode(), "a.perftake")


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), 1e308])
def test_damaged_times_of_frames_leave_the_end_mark_readable(tmp_path: Path, setup: TakeSetup, time_s: float) -> None:
    frames = [(0.0, MarkerFrame(0, -1e308)), (0.1, MarkerFrame(1, time_s))]
    write_whole_take(tmp_path / "a.perftake", setup, TakeNotes("a"), frames, [])
    take = read_take_file(tmp_path / "a.perftake")
    assert take.complete and summarise(take.path).duration_s == 0.0
    assert duration_s(1.0, 3.5) == 2.5

import gzip
import io
import struct
import zipfile
from pathlib import Path

import pytest
from perfanim.core.database.store import open_database
from perfanim.core.errors import PerfanimError
from perfanim.core.formats.markers.marker_files import READABLE, read_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.sketch.sketch_file import read_sketch
from perfanim.core.system.file_content import content_kind, decode_text, utf8_text, with_decimal_points
from perfanim.core.vision.sources.image_files import read_image

PAGE = b"\n<!DOCTYPE html>\n<html><body>Not found</body></html>" + b" " * 2000
WINDOWS_FILM = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c") + bytes(2000)
QUICKTIME = struct.pack(">I", 24) + b"ftypisom" + bytes(2000)


def packed() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("a.txt", "x")
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (PAGE, "a web page"),
        (
            b'<?xml version="1.0"?><!-- by us -->\n<Camera_Calibration version="2">',
            "an XML file (<Camera_Calibration>)",
        ),
        (WINDOWS_FILM, "a video (Windows Media)"),
        (QUICKTIME, "a video (MP4 or QuickTime)"),
        (b"RIFF\x00\x00\x00\x00AVI LIST", "a video (AVI)"),
        (packed(), "an archive (zip)"),
        (gzip.compress(b"x", mtime=0), "an archive (gzip)"),
        (b"\x89PNG\r\n\x1a\n", "a picture (PNG)"),
        (b"HIERARCHY\nROOT a", "a BVH file"),
        (b"PathFileType\t4", "a TRC file"),
        (b"frame,time_s,A_x\n", ""),
        (b"", ""),
    ],
)
def test_kinds_are_known_by_their_first_bytes(data: bytes, kind: str) -> None:
    assert content_kind(data) == kind


@pytest.mark.parametrize("data", [PAGE, WINDOWS_FILM, QUICKTIME])
@pytest.mark.parametrize("ending", [*READABLE, ".bvh", ".asf", ".toml", ".pfdb", ".png", ".sketch.csv"])
def test_readers_say_what_a_file_with_a_wrong_ending_is(tmp_path: Path, data: bytes, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(data)
    readers = {".bvh": read_motion, ".toml": load_rig, ".pfdb": open_database, ".png": read_image}
    if ending == ".asf":
        (tmp_path / "a.amc").write_text("1\nroot 0 0 0 0 0 0\n")
        path = tmp_path / "a.amc"
    read = read_motion if ending == ".asf" else readers.get(ending, read_take)
    with pytest.raises(PerfanimError, match=f"is {content_kind(data).split(' (')[0]}") as caught:
        read_sketch(path) if "sketch" in ending else read(path)
    assert "Traceback" not in str(caught.value)


def test_xml_of_another_program_is_no_calibration(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<Calibration><Camera id='1'/></Calibration>")
    with pytest.raises(PerfanimError, match=r"is another program's XML file \(<Calibration>\)"):
        load_rig(tmp_path / "a.xml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252"])
def test_texts_of_all_encodings_are_read(encoding: str) -> None:
    text = "frame,Hüfte_x\n1,0\n"
    assert decode_text(text.encode(encoding), "a.csv", "table") == text
    assert utf8_text(text.encode(encoding), "a.bvh", "BVH file") in (text.encode(), text.encode("cp1252"))


def test_decimal_commas_become_points_where_there_are_no_points() -> None:
    assert with_decimal_points(b"1,5 -0,25 7") == b"1.5 -0.25 7"
    assert with_decimal_points(b"1,5 -0.25 7") == b"1,5 -0.25 7"

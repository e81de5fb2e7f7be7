"""Large files of every kind: read or refused within bounded memory, and legal TOML of any size as Python reads it."""

import tomllib
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from perfanim.core.errors import FormatError, PerfanimError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.asf import read_asf
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.files import SLACK_BYTES, read_toml
from small_files import AMC, ASF

READERS: dict[str, Callable[[Path], object]] = {
    "a.toml": read_toml,
    "a.trc": read_take,
    "a.csv": read_take,
    "a.bvh": read_motion,
    "a.amc": lambda path: read_motion(path, path.with_name("skeleton.asf")),
    "a.asf": read_asf,
}


def table(ending: str, names: int, rows: int) -> str:
    """A TRC or CSV file that declares many columns, with rows of two fields."""
    if ending == "trc":
        header = "PathFileType\t4\t(X/Y/Z)\ta\nDataRate\tNumFrames\tNumMarkers\tUnits\n60\t1\t1000000\tmm\n"
        return header + "Frame#\tTime\t" + "\t".join(f"M{i}" for i in range(names)) + "\n\n" + "1\t0\n" * rows
    columns = ["frame", "time_s", *(f"M{i}_{axis}" for i in range(names) for axis in "xyz")]
    return "# fps=60\n" + ",".join(columns) + "\n" + "1,0\n" * rows


def still(joints: int, frames: int) -> str:
    """A BVH file with one channel, joints without any, and a number per frame."""
    children = "".join(f"JOINT a{index}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n}}\n" for index in range(joints))
    root = f"ROOT a\n{{\nOFFSET 0 1 0\nCHANNELS 1 Xrotation\n{children}}}\n"
    return f"HIERARCHY\n{root}MOTION\nFrames: 2\nFrame Time: 0.02\n" + "0\n" * frames


def many_bones(count: int) -> str:
    start, end = ASF.index("  begin\n    id 2"), ASF.index("  begin\n    id 3")
    bones = "".join(ASF[start:end].replace("lfemur", f"b{i}") for i in range(count))
    return ASF.replace(":hierarchy", bones + ":hierarchy")


# name of the case -> file name, content, and the sentence; None where it may be read as well
LARGE: dict[str, tuple[str, Callable[[], str], str | None]] = {
    "dotted key": ("a.toml", lambda: ".".join("a" * 20_000) + " = 1", "more than"),
    "dotted header": ("a.toml", lambda: "[" + " . ".join("a" * 20_000) + "]", "more than"),
    "dots of quoted names": ("a.toml", lambda: ".".join(['"a"'] * 20_000) + " = 1", "more than"),
    "dots after four quotes": (
        "a.toml", lambda: 'a = ["""x"""", "y"]\n' + ".".join("a" * 20_000) + " = 1", "more than",
    ),
    "tables": ("a.toml", lambda: "".join(f"[a{number}]\n" for number in range(100_000)), "more than"),
    "deep tables": ("a.toml", lambda: "".join(f"[a{number}{'.b' * 31}]\n" for number in range(5000)), "more than"),
    "inline tables": ("a.toml", lambda: "a = [" + "{b.c = 1}," * 60_000 + "]", "more than"),
    "keys": ("a.toml", lambda: "".join(f"a{number} = 1\n" for number in range(300_000)), "more than"),
    "digits": ("a.toml", lambda: "a = " + "1" * 1_000_000 + ".5", "more than"),
    "columns of TRC": ("a.trc", lambda: table("trc", 50_000, 50_000), "far more than it holds"),
    "columns of CSV": ("a.csv", lambda: table("csv", 20_000, 50_000), "far more than it holds"),
    "joints of BVH": ("a.bvh", lambda: still(20_000, 1), "has more than 2000 joints"),
    "bones of ASF": ("a.asf", lambda: many_bones(3000), "3003 bones"),
    "frames of BVH": ("a.bvh", lambda: still(0, 500_000), None),
    "joints without numbers": ("a.bvh", lambda: still(300, 480_000), None),
    "frame numbers of AMC": ("a.amc", lambda: AMC + "3\n]\n[" * 200_000, None),
    "blanks in AMC": ("a.amc", lambda: AMC + "\t " * 100_000 + "x", None),
    "blank lines in AMC": ("a.amc", lambda: AMC + "\n " * 100_000 + "x", None),
    "digits in AMC": ("a.amc", lambda: AMC[:-1] + "1" * 200_000, None),
    "last line of ASF": ("a.asf", lambda: ASF + "end\n" * 250_000, None),
    "names of CSV": ("a.csv", lambda: "# fps=60\nframe,time_s," + ",".join(["M_x,M_y,M_z"] * 80_000) + "\n1,0\n", None),
    "blank lines of CSV": ("a.csv", lambda: table("csv", 1, 0) + "\n" * 1_000_000, None),
    "short rows of CSV": ("a.csv", lambda: table("csv", 5, 0) + "1\n" * 500_000, None),
}  # fmt: skip
SLOW = ("frames of BVH", "joints without numbers", "names of CSV")


@pytest.mark.parametrize(
    ("name", "build", "sentence"),
    [pytest.param(*row, id=each, marks=pytest.mark.long if each in SLOW else []) for each, row in LARGE.items()],
)
def test_large_file_takes_bounded_memory(
    tmp_path: Path, name: str, build: Callable[[], str], sentence: str | None
) -> None:
    path, text = tmp_path / name, build()
    (tmp_path / "skeleton.asf").write_text(ASF)
    path.write_text(text)
    tracemalloc.start()
    with suppress(PerfanimError) if sentence is None else pytest.raises(FormatError, match=sentence):
        READERS[name](path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4 * len(text) + (1 << 20 if name == "a.toml" else SLACK_BYTES)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(f'a = "{"x." * 5000}"\nb = \'{"y." * 5000}\'\n"{"z." * 5000}" = 1', id="dots in texts"),
        pytest.param("# " + "." * 50_000 + "\na = 1 # [" + "=" * 300_000, id="dots in a comment"),
        pytest.param(
            'a = """\n' + "[x.y]" * 10_000 + '\\\\"" """\nb = ' + "'''" + "it's [a.b]" * 10_000 + "''''",
            id="long texts",
        ),
        pytest.param('a = """"x"""""\nb = 1.5', id="four quotes"),
        pytest.param(".".join("a" * 32) + " = 1", id="32 names"),
        pytest.param("a = [" + ", ".join(["-0.125"] * 20_000) + "]", id="many fractions"),
        pytest.param('[[take]]\ntake = "a.c3d"\nsubject = "b.toml"\nrate = 30.0\n' * 5000, id="many takes"),
        pytest.param(r'a = "\\"' + "\n" + r'b = "\"#[a.b"' + "\n", id="escapes"),
    ],
)
def test_legal_toml_is_read(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert read_toml(tmp_path / "a.toml") == tomllib.loads(text)

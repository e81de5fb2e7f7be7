import io
import json
import os
import shutil
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.mirroring import mirrored_rotations
from perfanim.core.body.motion import Motion, resampled
from perfanim.core.body.standard_skeleton import default_skeleton, scaled
from perfanim.core.cli.main import main
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.file_selection import behaviour_of, subject_of
from perfanim.core.database.store import open_database
from perfanim.core.errors import DatabaseError, FormatError
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.motion_sources import SkeletonNames
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.progress import Progress


def waving(name: str, frames: int = 31, fps: float = 30.0, height: float = 1.75) -> Motion:
    skeleton = scaled(default_skeleton(), height / 1.75)
    angle = np.sin(np.linspace(0.0, 6.0, frames))[:, None, None] * np.linspace(-0.5, 0.5, len(skeleton))[:, None]
    rotations = rot.from_rotation_vector(angle * np.array([0.3, 0.5, 0.8]))
    path = np.linspace(0.0, 1.0, frames)[:, None] * np.array([1.0, 0.0, 2.0]) + np.array([0.0, 0.9, 0.0])
    return Motion(name, fps, skeleton, rotations, path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    source = tmp_path / "motion"
    (source / "b").mkdir(parents=True)
    write_bvh(waving("walk_01"), source / "walk_01.bvh")
    write_bvh(waving("run_02", 61, 60.0, 1.9), source / "b" / "run_02.bvh", "cm")
    (source / "b" / "broken.bvh").write_text("HIERARCHY\nROOT a\n{")
    (source / "b" / "notes.txt").write_text("not motion")
    return source


def test_database_holds_the_motion_at_its_rate(folder: Path, tmp_path: Path) -> None:
    report = build_database([folder], tmp_path / "a.db", BuildSettings(fps=60.0))
    database = open_database(tmp_path / "a.db")
    assert report["frames"] == database.frames == 61 + 61
    assert report["clips"] == len(database.clips) == 2
    assert report["bytes"] == (tmp_path / "a.db").stat().st_size
    assert [(clip.name, clip.behaviour, clip.source_fps) for clip in database.clips] == [
        ("run_02", "run", 60.0),
        ("walk_01", "walk", 30.0),
    ]
    expected = resampled(waving("walk_01"), 60.0)
    clip = database.clips[1]
    found = database.local_rotations(slice(clip.start, clip.stop))
    assert np.degrees(rot.angle_between(found, expected.rotations)).max() < 1e-3
    np.testing.assert_allclose(database.root_positions_m[clip.start : clip.stop], expected.root_positions_m, atol=1e-5)
    heights = [skeleton.offsets_m[2, 1] for skeleton in database.skeletons]
    assert heights[0] / heights[1] == pytest.approx(1.9 / 1.75, abs=1e-4)


def test_bad_files_are_skipped_with_the_reason(folder: Path, tmp_path: Path) -> None:
    report = build_database([folder], tmp_path / "a.db")
    assert [row["file"] for row in report["skipped"]] == ["motion/b/broken.bvh"]
    assert "no MOTION section" in report["skipped"][0]["reason"]
    assert str(tmp_path) not in report["skipped"][0]["reason"]


def test_exclude_by_name_stem_or_folder(folder: Path, tmp_path: Path) -> None:
    for pattern in ("run_02", "run*", "motion/b/*"):
        report = build_database([folder], tmp_path / "a.db", BuildSettings(exclude=[pattern]))
        assert report["clips"] == 1
        assert report["behaviours"] == {"walk": 61}


def test_include_and_exclude_by_name_and_behaviour(folder: Path, tmp_path: Path) -> None:
    (folder / "index.tsv").write_text("trial\tdescription\nrun_02\tSprint - fast\nwalk_01\tstroll\n")

    def names(**chosen: list[str]) -> list[str]:
        build_database([folder], tmp_path / "a.db", BuildSettings(**chosen))
        return [clip.name for clip in open_database(tmp_path / "a.db").clips]

    assert names(include=["stroll"]) == names(include=["walk_*"]) == names(exclude=["sprint"]) == ["walk_01"]
    assert names(include=["stroll", "run_02.bvh"]) == ["run_02", "walk_01"]
    assert names(include=["*_0*"], exclude=["stroll"]) == ["run_02"]
    with pytest.raises(
        DatabaseError, match=r"or behaviour matches 'swim'; choose from the behaviours broken, sprint, stroll"
    ):
        names(include=["swim"])
    with pytest.raises(DatabaseError, match="no usable motion"):
        names(exclude=["*"])


def test_mirrored_copies_follow_their_originals(folder: Path, tmp_path: Path) -> None:
    plain = build_database([folder], tmp_path / "a.db")
    report = build_database([folder], tmp_path / "b.db", BuildSettings(mirror=True))
    database = open_database(tmp_path / "b.db")
    assert (report["frames"], report["mirrored_clips"]) == (2 * plain["frames"], 2)
    assert [(clip.name, clip.mirrored) for clip in database.clips] == [
        ("run_02", False),
        ("run_02", True),
        ("walk_01", False),
        ("walk_01", True),
    ]
    motion = waving("walk_01")
    original, image = (database.local_rotations(slice(clip.start, clip.stop)) for clip in database.clips[2:])
    assert np.degrees(rot.angle_between(original, resampled(motion, 60.0).rotations)).max() < 1e-3
    assert np.degrees(rot.angle_between(image, mirrored_rotations(original))).max() < 1e-3
    # an even body is its own mirror image
    assert len(database.skeletons) == 2


def test_near_duplicates_are_culled_and_counted(folder: Path, tmp_path: Path) -> None:
    write_bvh(waving("again", 31, 30.0, 1.6), folder / "x_again.bvh")
    plain = build_database([folder], tmp_path / "a.db")
    report = build_database([folder], tmp_path / "b.db", BuildSettings(cull_deg=0.5))
    assert report["culled_frames"] == plain["frames"] - report["frames"] >= 61
    database = open_database(tmp_path / "b.db")
    assert database.culled_frames == report["culled_frames"]
    assert "x_again" not in [clip.name for clip in database.clips]
    assert plain["culled_frames"] == open_database(tmp_path / "a.db").culled_frames == 0


def _with_limb_pop(motion: Motion, at: int) -> Motion:
    rotations = motion.rotations.copy()
    turn = rot.from_rotation_vector(np.radians([0.0, 120.0, 0.0]))
    rotations[at : at + 2, 1] = rot.multiply(rotations[at : at + 2, 1], turn)
    return replace(motion, rotations=rotations)


def test_defects_are_named_and_the_rest_is_imported(folder: Path, tmp_path: Path) -> None:
    """A limb pop after frames without numbers, and a wrong frame count: frames are those of the file, from 1."""
    path = folder / "b" / "run_02.bvh"
    write_bvh(_with_limb_pop(waving("run_02", 61, 60.0), 40), path)
    lines = path.read_text().replace("Frames: 61", "Frames: 70").splitlines()
    lines[-61 + 10] = "nan " + lines[-61 + 10].split(" ", 1)[1]
    path.write_text("\n".join(lines) + "\n")
    (folder / "binary.bvh").write_bytes(bytes(range(256)) * 20)
    (folder / "cut.bvh").write_bytes((folder / "walk_01.bvh").read_bytes()[:-100])
    (folder / "binary.amc").write_bytes(bytes(range(256)) * 20)
    report = build_database([folder], tmp_path / "a.db")
    name = "motion/b/run_02.bvh"
    assert report["defects"] == [
        {"file": name, "frames": "", "defect": "declares 70 frames, but has 61", "done": "all frames present are used"},
        {"file": name, "frames": "11", "defect": "numbers that are not finite", "done": "cut out"},
        {"file": name, "frames": "41-42", "defect": "limb pop of lfemur", "done": "cut out"},
    ]
    database = open_database(tmp_path / "a.db")
    assert [(clip.first_frame, clip.stop - clip.start) for clip in database.clips if clip.name == "run_02"] == [
        (0, 10),
        (11, 29),
        (42, 19),
    ]
    assert "walk_01" in [clip.name for clip in database.clips]
    skipped = {row["file"]: (row["line"], row["reason"]) for row in report["skipped"]}
    assert set(skipped) == {"motion/b/broken.bvh", "motion/binary.bvh", "motion/cut.bvh", "motion/binary.amc"}
    last = (folder / "walk_01.bvh").read_text().count("\n")
    assert skipped["motion/cut.bvh"][0] == last
    assert "values in its last row" in skipped["motion/cut.bvh"][1]
    assert "is not a BVH file" in skipped["motion/binary.bvh"][1]
    assert "has no skeleton" in skipped["motion/binary.amc"][1]
    assert not any("\n" in reason for _, reason in skipped.values())


def test_frames_without_numbers_split_the_clip(folder: Path, tmp_path: Path) -> None:
    path = folder / "walk_01.bvh"
    lines = path.read_text().splitlines()
    lines[-20] = "nan " + lines[-20].split(" ", 1)[1]
    path.write_text("\n".join(lines) + "\n")
    report = build_database([path], tmp_path / "a.db", BuildSettings(fps=30.0))
    assert report["frames"] == 30
    assert report["clips"] == 2
    row = {"file": "walk_01.bvh", "frames": "12", "defect": "numbers that are not finite", "done": "cut out"}
    assert (report["skipped"], report["defects"]) == ([], [row])
    clips = open_database(tmp_path / "a.db").clips
    assert [(clip.name, clip.first_frame, clip.stop - clip.start) for clip in clips] == [
        ("walk_01", 0, 11),
        ("walk_01", 12, 19),
    ]


def _zip(folder: Path, target: Path) -> Path:
    with zipfile.ZipFile(target, "w") as archive:
        for path in sorted(folder.rglob("*.*")):
            archive.write(path, path.relative_to(folder.parent))
    return target


def _tar(folder: Path, target: Path) -> Path:
    with tarfile.open(target, "w:xz") as archive:
        archive.add(folder, folder.name)
    return target


def test_archives_hold_the_same_as_folders(folder: Path, tmp_path: Path) -> None:
    plain = build_database([folder], tmp_path / "a.db")
    for archive in (_zip(folder, tmp_path / "m.zip"), _tar(folder, tmp_path / "m.tar.xz")):
        report = build_database([archive], tmp_path / "b.db")
        assert (report["frames"], report["clips"]) == (plain["frames"], plain["clips"])
        assert (tmp_path / "b.db").read_bytes()[-5000:] == (tmp_path / "a.db").read_bytes()[-5000:]


def test_sources_of_one_name_are_all_read(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other" / "motion").mkdir(parents=True)
    write_bvh(waving("walk_01", 41), tmp_path / "other" / "motion" / "walk_01.bvh")
    report = build_database([folder, tmp_path / "other" / "motion"], tmp_path / "a.db", BuildSettings(fps=30.0))
    assert report["frames"] == 31 + 31 + 41
    twice = build_database([folder, folder / "walk_01.bvh"], tmp_path / "a.db", BuildSettings(fps=30.0))
    assert twice["clips"] == 2


def test_archive_members_cannot_lead_out(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "evil.tar"
    content = (folder / "walk_01.bvh").read_bytes()
    with tarfile.open(target, "w") as archive:
        member = tarfile.TarInfo("../../escaped.bvh")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    before = set(tmp_path.parent.rglob("escaped*"))
    assert build_database([target], tmp_path / "a.db")["clips"] == 1
    assert set(tmp_path.parent.rglob("escaped*")) == before


@pytest.mark.parametrize("suffix", [".zip", ".tar.xz", ".tar.gz", ".tar"])
def test_damaged_archive(folder: Path, tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"m{suffix}"
    if suffix == ".zip":
        _zip(folder, target)
    else:
        with tarfile.open(target, "w:" + suffix[5:]) as archive:
            archive.add(folder, folder.name)
    target.write_bytes(target.read_bytes()[: target.stat().st_size // 2])
    with pytest.raises(FormatError, match="damaged archive"):
        build_database([target], tmp_path / "a.db")
    assert not (tmp_path / "a.db").exists()


def test_missing_source_and_nothing_usable(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(FormatError, match="does not exist"):
        build_database([tmp_path / "none"], tmp_path / "a.db")
    with pytest.raises(DatabaseError, match="no usable motion"):
        build_database([folder / "b" / "broken.bvh"], tmp_path / "a.db")
    with pytest.raises(FormatError, match="neither motion nor an archive"):
        build_database([folder / "b" / "notes.txt"], tmp_path / "a.db")
    assert not (tmp_path / "a.db").exists()


def cancelled_at(last: int) -> Progress:
    """Progress that is interrupted, as by Ctrl-C, at its step of this number, from 0."""
    steps = iter(range(last))

    def progress(fraction: float, text: str) -> None:
        if next(steps, None) is None:
            raise KeyboardInterrupt

    return progress


def test_cancelled_build_writes_nothing(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        build_database([folder], tmp_path / "a.db", progress=cancelled_at(1))
    assert not (tmp_path / "a.db").exists()


def test_several_processes_give_the_same(folder: Path, tmp_path: Path) -> None:
    one = build_database([folder], tmp_path / "a.db", BuildSettings(workers=1))
    two = build_database([folder], tmp_path / "b.db", BuildSettings(workers=2))
    assert (tmp_path / "a.db").read_bytes() == (tmp_path / "b.db").read_bytes()
    assert one["skipped"] == two["skipped"]
    assert one["defects"] == two["defects"]


def test_a_cancelled_build_ends_its_processes(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        build_database([folder], tmp_path / "a.db", BuildSettings(workers=2), progress=cancelled_at(2))
    own = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    if own.is_file():
        assert not any("reading.py" in Path(f"/proc/{child}/cmdline").read_text() for child in own.read_text().split())
    assert [path for path in tmp_path.iterdir() if path != folder] == []


def test_an_unwritable_target_is_told_before_any_work(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    steps: list[str] = []
    with pytest.raises(FormatError, match="cannot be written"):
        build_database([folder], tmp_path / "file" / "a.db", progress=lambda _, text: steps.append(text))
    assert steps == []


def test_skeleton_of_an_amc_file() -> None:
    names = SkeletonNames(
        ["w/16.asf", "x/14/14.asf", "x/15/15.asf", "x/16/other.asf", "z/16.asf", "z/a.asf", "z/A.asf"]
    )
    assert names.of("x/14/14_02.amc") == "x/14/14.asf"
    assert names.of("y/15_01.amc") == "x/15/15.asf"
    assert names.of("x/16/18_01.amc") == "x/16/other.asf"
    assert names.of("z/16_01.amc") == "z/16.asf", "beside it before elsewhere"
    assert names.of("y/16_01.amc") == "w/16.asf", "the first elsewhere"
    assert names.of("z/a.amc") == "z/a.asf"
    assert names.of("z/b.amc") is None, "several are beside it"
    assert names.of("y/17_01.amc") is None


@pytest.mark.parametrize(
    ("name", "description", "behaviour", "subject"),
    [
        ("cmu/14/14_02.amc", "Boxing - fast", "boxing", "14"),
        ("bandai/dataset-2/dataset-2_walk-turn-left_active_001.bvh", "", "walk-turn-left", "dataset-2 active"),
        ("takes/FastRun2.bvh", "", "fast run", "takes"),
    ],
)
def test_labels(name: str, description: str, behaviour: str, subject: str) -> None:
    assert behaviour_of(name, description) == behaviour
    assert subject_of(name) == subject


def test_cmu_folder_with_descriptions(cmu_dir: Path, tmp_path: Path) -> None:
    source = tmp_path / "cmu"
    source.mkdir()
    shutil.copytree(cmu_dir / "35", source / "35", copy_function=shutil.copy)
    shutil.copy(cmu_dir / "index.tsv", source)
    report = build_database([source], tmp_path / "a.db", BuildSettings(exclude=["35_1*", "35_2*", "35_3*"]))
    database = open_database(tmp_path / "a.db")
    assert report["skipped"] == []
    assert "35_01" in [clip.name for clip in database.clips]
    assert set(database.behaviours) <= {"walk", "run/jog", "run", "navigate around obstacles"}
    assert {clip.subject for clip in database.clips} == {"35"}


def test_amc_without_skeleton_is_skipped(cmu_dir: Path, tmp_path: Path, folder: Path) -> None:
    shutil.copy(cmu_dir / "35" / "35_01.amc", folder)
    report = build_database([folder], tmp_path / "a.db")
    reasons = {row["file"]: row["reason"] for row in report["skipped"]}
    assert "has no skeleton" in reasons["motion/35_01.amc"]


@pytest.mark.parametrize("archive", [None, _zip, _tar])
def test_a_damaged_skeleton_file_is_named_as_such(
    cmu_dir: Path, folder: Path, tmp_path: Path, archive: Callable[[Path, Path], Path] | None
) -> None:
    shutil.copy(cmu_dir / "35" / "35_01.amc", folder)
    text = (cmu_dir / "35" / "35.asf").read_text().splitlines()
    number = next(i for i, line in enumerate(text) if "direction" in line)
    text[number] = "direction 0 1"
    (folder / "35.asf").write_text("\n".join(text))
    source = archive(folder, tmp_path / f"a.{'zip' if archive is _zip else 'tar.xz'}") if archive else folder
    report = build_database([source], tmp_path / "a.db")
    row = next(row for row in report["skipped"] if row["file"].endswith("35_01.amc"))
    assert row["line"] is None
    words = "needs 3 numbers, has 2; repair the file, or export it again"
    assert row["reason"] == f"the skeleton file, line {number + 1}: {words}"


def test_what_is_too_short_is_named(folder: Path, tmp_path: Path) -> None:
    write_bvh(waving("short", 2, 60.0), folder / "short.bvh")
    report = build_database([folder], tmp_path / "a.db")
    row = {"file": "motion/short.bvh", "frames": "1-2"}
    row["defect"] = "only 2 frames at 60 Hz, but at least 4 are needed"
    assert report["defects"] == [row | {"done": "left out"}]


def test_what_leaves_nothing_is_named(folder: Path, tmp_path: Path) -> None:
    write_bvh(waving("short", 1, 60.0), tmp_path / "short.bvh")
    with pytest.raises(DatabaseError, match=r"short.bvh: only 1 frame at 60 Hz, but at least 4 are needed"):
        build_database([tmp_path / "short.bvh"], tmp_path / "a.db")
    with zipfile.ZipFile(tmp_path / "outer.zip", "w") as outer:
        outer.write(_zip(folder, tmp_path / "inner.zip"), "sub/inner.zip")
    with pytest.raises(DatabaseError, match=r"outer.zip/sub/inner.zip: is an archive inside an archive; unpack it"):
        build_database([tmp_path / "outer.zip"], tmp_path / "a.db")


def test_command_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["database", "build", str(folder), "--out", str(tmp_path / "a.db"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 122
    assert main(["database", "info", str(tmp_path / "a.db"), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["behaviours"] == {"run": 61, "walk": 61}
    assert info["source_fps"] == {"60": 61, "30": 61}
    assert (info["mirrored_clips"], info["culled_frames"]) == (0, 0)
    assert len(info["joints"]) == 29
    assert main(["database", "build", str(tmp_path / "none"), "--out", str(tmp_path / "b.db")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "does not exist" in error
    assert main(["database", "info", str(folder / "walk_01.bvh")]) == 1
    capsys.readouterr()
    options = ["--mirror", "--cull", "0.5", "--include", "walk", "--workers", "2", "--json"]
    assert main(["database", "build", str(folder), "--out", str(tmp_path / "b.db"), *options]) == 0
    assert json.loads(capsys.readouterr().out)["mirrored_clips"] == 1
    for wrong in (["--cull", "-1"], ["--cull", "nan"], ["--workers", "0"], ["--fps", "0"]):
        assert main(["database", "build", str(folder), "--out", str(tmp_path / "c.db"), *wrong]) == 1
        assert "out of range" in capsys.readouterr().err

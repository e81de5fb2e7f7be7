"""The whole chain on a recording by others: board points, images, a performer who only walks, a solved motion."""

import json
import shutil

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.subject import load_subject
from scipy.interpolate import interp1d

MARKERS = "two-webcams"
FIRST, LAST = 1700, 1850  # pairs of the fourth sequence by their numbers: 5 s, several steps away from the cameras
SMOOTHING_HZ = 6.0


def run(capsys, *line: object) -> dict[str, object]:
    """Run a command as a user does and return what it tells."""
    capsys.readouterr()
    assert main([*map(str, line), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def walks(cmu_dir):
    """CMU's walks on level ground, by its own descriptions."""
    rows = [line.split("\t") for line in (cmu_dir / "index.tsv").read_text().splitlines()[1:]]
    kept = [row[3] for row in rows if "walk" in row[4].lower() and row[3].split("/")[0] in ("07", "16", "35")]
    assert len(kept) >= 20
    return [cmu_dir / path for path in kept]


@pytest.fixture
def folder(shared_dir, tmp_path):
    """Two folders with the pictures of the part that is looked at."""
    pictures = shared_dir / "two-webcams" / "sequence4"
    for side in ("1", "2"):
        (tmp_path / side).mkdir()
        chosen = [p for p in pictures.glob(f"*_{side}.jpg") if FIRST <= int(p.name.split("_")[0]) < LAST]
        assert len(chosen) == LAST - FIRST
        for path in chosen:
            shutil.copy(path, tmp_path / side)
    return tmp_path


@pytest.mark.long
def test_walking_performer_becomes_a_walking_character(folder, shared_dir, walks, capsys):
    points = shared_dir / "two-webcams" / "stereo_calibration.json"
    rig, level, take_file = folder / "cameras.toml", folder / "level.toml", folder / "walk.take.npz"
    database, subject_file, out = folder / "walks.db", folder / "subject.toml", folder / "walk.bvh"

    assert run(capsys, "calibrate", "cameras", "--points", points, "--out", rig)["verdict"] == "good"
    tracked = run(
        capsys, "track", "--cameras", rig, "--left", folder / "1", "--right", folder / "2", "--marker-set", MARKERS,
        "--floor", "feet", "--floor-cameras", level, "--out", take_file,
    )  # fmt: skip
    assert tracked["all_visible_fraction"] >= 0.95
    assert tracked["reprojection_rms_px"] <= 0.6
    built = run(capsys, "database", "build", *walks, "--fps", 30, "--out", database)
    assert built["skipped"] == []
    jumps = [row["file"] for row in built["defects"] if row["defect"] == "root jump"]
    assert jumps == ["16_17.amc"]
    assert built["clips"] == len(walks) + len(jumps)
    fitted = run(
        capsys, "calibrate", "subject", take_file, "--marker-set", MARKERS, "--database", database,
        "--out", subject_file,
    )  # fmt: skip
    assert fitted["residual_mm"] < 12.0
    assert fitted["advice"] == []
    solved = run(
        capsys, "solve", take_file, "--subject", subject_file, "--database", database, "--smooth", SMOOTHING_HZ,
        "--out", out,
    )  # fmt: skip
    assert solved["frames"] == LAST - FIRST
    assert solved["marker_rms_mm"] < 15.0
    (uneven,) = solved["warnings"]  # what webcams are like
    assert "frames are unevenly spaced" in uneven and "outputs have 30 per second" in uneven

    take, subject, motion = read_take(take_file), load_subject(subject_file), read_motion(out)
    check_cameras(load_rig(level), take)
    check_body(motion)
    check_markers(motion, take, subject)
    check_legs(motion)


def check_cameras(rig, take):
    """The take is in the world of the levelled cameras, which hang at a man's height and see it in the picture."""
    for camera in rig.cameras:
        assert 0.2 < camera.centre_m[1] < 2.5
        pixels = camera.project(take.positions_m[np.isfinite(take.positions_m[..., 0])])
        assert np.all((pixels > 0) & (pixels < camera.image_size))


def check_body(motion):
    """Bones of one length all the time, and as long as those of a person of about 1.6 m."""
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    index = motion.skeleton.index
    for joint in ("ltibia", "rtibia", "lfoot", "rfoot", "head", "lhand"):
        parent = int(motion.skeleton.parents[index(joint)])
        lengths = np.linalg.norm(positions[:, index(joint)] - positions[:, parent], axis=1)
        assert np.ptp(lengths) < 1e-6
    assert 0.33 < np.linalg.norm(motion.skeleton.offsets_m[index("ltibia")]) < 0.47  # thigh
    assert 0.33 < np.linalg.norm(motion.skeleton.offsets_m[index("lfoot")]) < 0.47  # shank
    head = positions[:, index("head"), 1]
    assert np.all((head > 1.15) & (head < 1.65))
    assert np.all((positions[:, 0, 1] > 0.75) & (positions[:, 0, 1] < 1.05))
    trunk = positions[:, index("lowerneck")] - positions[:, 0]
    lean = np.degrees(np.arctan2(np.linalg.norm(trunk[:, [0, 2]], axis=1), trunk[:, 1]))
    assert lean.max() < 20.0


def check_markers(motion, take, subject):
    """The character's markers stay with the performer's; no marker stands for another."""
    markers = subject.marker_set.positions_on(motion.skeleton, motion.rotations, motion.root_positions_m)
    columns = [take.names.index(name) for name in subject.marker_set.names]
    times_s = take.times_s[0] + np.arange(motion.frames) / motion.fps  # steady, unlike the take's
    seen = interp1d(take.times_s, take.positions_m[:, columns], axis=0, bounds_error=False)(times_s)
    distance = np.linalg.norm(markers - seen, axis=2)
    assert np.nanmedian(distance) < 0.02
    assert np.nanmax(np.nanmedian(distance, axis=0)) < 0.04


def check_legs(motion):
    """Knees bend backwards, as far as in walking; feet stand on the floor in turn, and not below it."""
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    index = motion.skeleton.index
    side = rot.rotate(world[:, 0], np.array([1.0, 0.0, 0.0]))
    lowest = []
    for leg in "lr":
        hip, knee, ankle, toes = (positions[:, index(leg + j)] for j in ("femur", "tibia", "foot", "toes"))
        thigh, shank = knee - hip, ankle - knee
        bent = np.degrees(np.arctan2(np.sum(np.cross(thigh, shank) * side, axis=1), np.sum(thigh * shank, axis=1)))
        assert bent.min() > -12.0
        assert 30.0 < bent.max() < 85.0
        assert np.percentile(toes[:, 1], 1) > -0.03
        assert 0.05 < np.ptp(ankle[:, 1]) < 0.35
        lowest.append(toes[:, 1])
    standing = np.minimum(*lowest)
    assert np.percentile(standing, 95) < 0.08
    forward = rot.rotate(world[:, 0], np.array([0.0, 0.0, 1.0]))
    assert forward[:, 2].min() > 0.5  # faces the cameras all the time, as in the pictures
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    assert steps.max() < 0.25  # no flips


@pytest.mark.long
def test_a_set_with_fewer_markers_than_the_pictures_show_is_doubted(folder, shared_dir, capsys):
    points = shared_dir / "two-webcams" / "stereo_calibration.json"
    verdicts = {}
    for marker_set in ("boxing", MARKERS):
        told = run(
            capsys, "take", "import", folder / "1", folder / "2", "--cameras", points, "--marker-set", marker_set,
            "--out", folder / marker_set,
        )  # fmt: skip
        (row,) = told["takes"]
        verdicts[marker_set] = row["verdict"]
        assert read_take_file(row["out"]).notes.verdict == row["verdict"]
    assert verdicts["boxing"].startswith("nearly every frame shows 12 markers, but 9 are worn")
    assert verdicts[MARKERS] == "good"

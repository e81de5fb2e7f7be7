import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from perfanim.core.geometry.rig_file import save_rig

SIZE = (320, 240)
BODY = np.array([[-0.3, 0.4, 0.0], [0.3, 0.35, 0.0], [0.0, 0.0, 0.1], [-0.2, -0.4, 0.0], [0.25, -0.45, 0.05]])
FRAMES = 20


def studio(folder: Path, late: float = 0.0, moved: Callable[[float], np.ndarray] | None = None) -> CameraRig:
    """Two image folders of five markers that move, and the calibration; the right camera is `late` frames late."""
    matrix = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
    rotation = WORLD_FROM_CAMERA
    cameras = tuple(
        Camera(name, SIZE, matrix, rotation=rotation, translation_m=-rotation @ np.array([x_m, 0.0, 0.0]))
        for name, x_m in (("left", -0.3), ("right", 0.3))
    )
    rng = np.random.default_rng(0)
    for camera in cameras:
        (folder / camera.name).mkdir()
        for number in range(FRAMES):
            picture = rng.normal(8, 1.5, (SIZE[1], SIZE[0], 3)).clip(0, 255).astype(np.uint8)
            for pixel in camera.project((moved or where)(number + (late if camera.name == "right" else 0.0))):
                centre = tuple(int(v) for v in np.round(pixel * 16))
                cv2.circle(picture, centre, 4 * 16, (230, 230, 230), -1, cv2.LINE_AA, 4)
            cv2.imwrite(str(folder / camera.name / f"{number:03d}.png"), picture)
    rig = CameraRig(cameras)
    save_rig(rig, folder / "cameras.toml")
    return rig


def where(number: float) -> np.ndarray:
    return BODY + np.array([0.02 * number - 0.2, 0.005 * number, -2.5])


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    studio(folder)
    return folder


@pytest.fixture
def folder(filmed, tmp_path) -> Path:
    """A copy of the studio, to write into."""
    return shutil.copytree(filmed, tmp_path, dirs_exist_ok=True)


def arguments(folder: Path, *more: str) -> list[str]:
    return [
        "track", "--cameras", f"{folder}/cameras.toml", "--left", f"{folder}/left", "--right", f"{folder}/right", *more
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["take.take.npz", "take.trc", "take.csv"])
def test_images_become_a_take(folder, capsys, name):
    out = folder / name
    assert main(arguments(folder, "--out", str(out), "--fps", "25", "--json")) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frames"], summary["markers"], summary["visible_fraction"]) == (FRAMES, 5, 1.0)
    assert summary["reprojection_rms_px"] < 0.15
    assert summary["frames_per_s"] > 0
    take = read_take(out)
    assert take.fps == pytest.approx(25.0)
    truth = np.array([where(number) for number in range(FRAMES)])
    distance = np.linalg.norm(take.positions_m[:, :, None] - truth[:, None], axis=3)
    assert distance.min(axis=2).max() < 0.01
    assert np.ptp(distance.argmin(axis=2), axis=0).max() == 0  # one marker each, all the way


def test_a_camera_that_is_late_is_noticed_and_made_good_for(tmp_path, capsys):
    def waving(number: float) -> np.ndarray:
        turn = 0.4 * number + np.arange(5)
        return BODY + np.stack((0.1 * np.cos(turn), 0.1 * np.sin(turn), -2.5 + 0.0 * turn), axis=1)

    studio(tmp_path, 0.4, waving)
    distances, summaries = [], []
    for more in ([], ["--no-time-offset"]):
        out = tmp_path / "take.take.npz"
        assert main(arguments(tmp_path, "--out", str(out), "--fps", "25", "--json", *more)) == 0
        summaries.append(json.loads(capsys.readouterr().out))
        take = read_take(out)
        truth = np.array([waving(25.0 * time_s) for time_s in take.times_s])
        apart = np.linalg.norm(take.positions_m[:, :, None] - truth[:, None], axis=3)
        distances.append(np.nanmedian(apart.min(axis=2)))
    recorded = tmp_path / "take.perftake"
    assert main(arguments(tmp_path, "--out", str(recorded), "--fps", "25", "--json")) == 0
    summaries.append(json.loads(capsys.readouterr().out))
    told, untold, kept = summaries
    assert kept["time_offsets_ms"] == told["time_offsets_ms"] and kept["time_offsets_applied"]
    frames = read_take_file(recorded).frames
    assert len(frames) == FRAMES and any(
        np.any(a != b) for a, b in zip(frames[9].blobs, frames[9].detected, strict=True)
    )
    apart = [np.linalg.norm(f.points_m[:, None] - waving(25.0 * f.time_s), axis=2).min(axis=1) for f in frames]
    assert np.median(np.concatenate(apart)) < 0.5 * distances[1]
    assert told["time_offsets_ms"] == [0.0, pytest.approx(16.0, abs=1.0)]
    assert told["time_offsets_applied"]
    assert "time_offsets_ms" not in untold
    assert distances[0] < 0.5 * distances[1]


def film(folder: Path, name: str, every: int = 1, code: str = "MJPG") -> Path:
    """A film of every n-th picture of a side, at an n-th of 25 frames per second."""
    path, side = folder / name, name.partition(".")[0]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 25.0 / every, SIZE)
    for number in range(0, FRAMES, every):
        writer.write(cv2.imread(str(folder / side / f"{number:03d}.png")))
    writer.release()
    return path


def test_films_of_two_rates_are_paired_in_time(folder, capsys):
    films = ["--left", film(folder, "left.avi"), "--right", film(folder, "right.avi", every=2)]
    line = ["track", "--cameras", folder / "cameras.toml", *films, "--out", folder / "take.take.npz", "--json"]
    assert main([*map(str, line)]) == 0
    told, take = json.loads(capsys.readouterr().out), read_take(folder / "take.take.npz")
    assert any("left.avi 25" in text and "right.avi 12.5" in text for text in told["warnings"])
    assert (take.frames, take.fps) == (FRAMES // 2, 12.5)
    truth = np.array([where(25.0 * (time_s - take.times_s[0])) for time_s in take.times_s])
    distance = np.linalg.norm(take.positions_m[:, :, None] - truth[:, None], axis=3)
    assert np.nanmax(distance.min(axis=2)) < 0.01 and take.visible.mean() > 0.8


def test_a_film_that_cannot_be_read_is_named(folder, capsys):
    path = film(folder, "left.mp4", code="mp4v")
    path.write_bytes(path.read_bytes().replace(b"mp4v", b"av01").replace(b"esds", b"free"))
    line = ["track", "--cameras", f"{folder}/cameras.toml", "--left", str(path)]
    assert main([*line, "--out", f"{folder}/a.take.npz"]) == 1
    assert "is a video in AV1, which cannot be read here; convert it to H.264" in capsys.readouterr().err


def test_distance_to_other_trajectories_is_told(folder, capsys):
    first = folder / "first.trc"
    assert main(arguments(folder, "--out", str(first))) == 0
    capsys.readouterr()
    assert main(arguments(folder, "--out", str(folder / "second.trc"), "--truth", str(first), "--json")) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["distance_median_mm"] < 0.01
    assert summary["truth_frames"] == FRAMES


def test_frames_without_the_performer_give_the_background(folder, capsys):
    for side in ("left", "right"):
        (folder / f"empty-{side}").mkdir()
        for number in range(5):
            picture = np.random.default_rng(number).normal(8, 1.5, (SIZE[1], SIZE[0], 3)).clip(0, 255).astype(np.uint8)
            cv2.imwrite(str(folder / f"empty-{side}" / f"{number}.png"), picture)
    empty = ["--background", f"{folder}/empty-left", f"{folder}/empty-right"]
    assert main(arguments(folder, "--out", str(folder / "take.trc"), *empty, "--json")) == 0
    assert json.loads(capsys.readouterr().out)["visible_fraction"] == 1.0


def test_too_few_markers_for_the_set_are_told(folder, capsys):
    assert main(arguments(folder, "--marker-set", "boxing", "--out", str(folder / "take.trc"))) == 1
    assert "no frame shows more than 5 of 9 markers" in capsys.readouterr().err
    assert not (folder / "take.trc").exists()


@pytest.mark.parametrize(("worn", "doubts"), [(3, 1), (4, 0), (5, 0)])  # one further may be a reflection
def test_more_markers_than_are_worn_are_doubted(folder, capsys, worn, doubts):
    assert main(arguments(folder, "--markers", str(worn), "--out", str(folder / "take.perftake"), "--json")) == 0
    told = json.loads(capsys.readouterr().out).get("doubts", [])
    text = f"nearly every frame shows 5 markers, but {worn} are worn; choose the marker set that was worn"
    assert told == [text] * doubts


@pytest.mark.parametrize("chosen", [["--left", "left"], ["--camera", "right=right"]])
def test_one_camera_gives_trajectories_in_its_image(folder, capsys, chosen):
    out = folder / "one.take.npz"
    source = chosen[1].rpartition("=")
    command = ["track", "--cameras", f"{folder}/cameras.toml", chosen[0], f"{''.join(source[:2])}{folder}/{source[2]}"]
    assert main([*command, "--out", str(out), "--fps", "25", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frames"], summary["markers"]) == (FRAMES, 5)
    assert (summary["visible_fraction"], summary["one_camera_fraction"]) == (0.0, 1.0)
    take = read_take(out)
    assert not take.visible.any()
    (camera,) = take.single.rig.cameras
    assert camera.name == source[2]
    for number in (0, FRAMES - 1):
        seen = take.single.points[number]
        true = camera.undistort(camera.project(where(number)))
        nearest = np.linalg.norm(seen[:, None] - true, axis=-1).min(axis=1)
        assert nearest.max() < 0.5 / 300.0  # half a pixel
    # a column is one marker
    assert np.abs(np.diff(take.single.points, axis=0)).max() < 0.05


def test_one_camera_gives_a_recorded_take(folder, capsys):
    out = folder / "one.perftake"
    command = ["track", "--cameras", f"{folder}/cameras.toml", "--camera", f"right={folder}/right", "--out", str(out)]
    assert main([*command, "--fps", "25", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frames"], summary["markers"], summary["one_camera_fraction"]) == (FRAMES, 5, 1.0)
    take = read_take_file(out)
    (camera,) = take.setup.camera_rig().cameras
    assert camera.name == "right"
    for frame in (take.frames[0], take.frames[-1]):
        true = camera.undistort(camera.project(where(frame.number)))
        assert np.linalg.norm(frame.single_points[:, None] - true, axis=-1).min(axis=1).max() < 0.5 / 300.0


def test_what_one_camera_cannot_give_is_refused(folder, capsys):
    one = ["track", "--cameras", f"{folder}/cameras.toml", "--left", f"{folder}/left", "--json"]
    for more, reason in (
        (["--out", f"{folder}/one.trc"], "one.trc: cannot hold what one camera shows"),
        (["--out", f"{folder}/one.take.npz", "--truth", f"{folder}/truth.trc"], "needs 3D markers"),
        (["--out", f"{folder}/one.take.npz", "--camera", f"left={folder}/right"], "one camera is given two sources"),
    ):
        assert main([*one, *more]) == 1
        assert reason in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["track", "--cameras", f"{folder}/cameras.toml", "--out", f"{folder}/one.take.npz"])
    assert not list(folder.glob("one.*"))

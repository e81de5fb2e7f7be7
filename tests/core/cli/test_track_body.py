"""One labeller for images and live captures: what `track` writes, labelled by the body."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import commands
import cv2
import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.cli.main import main
from perfanim.core.database.store import open_database
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.markers.marker_frame_codec import pack
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import load_subject, save_subject
from perfanim.core.session.delayed_poses import calm_performer
from perfanim.core.session.session import Session
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import simulated_source
from perfanim.core.simulate.studio.stage_placement import on_stage
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.system.assets import MOTION
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.core.vision.sources.source_kinds import open_image_source

FPS = 30.0
EMPTY = 8
FAR_M = 0.03  # further from its true place a marker is another one


@dataclass(frozen=True)
class Film:
    """Images of a boxer whom the database does not know, in the middle of the boxing."""

    folder: Path
    truth: np.ndarray

    def command(self, *more: object) -> list[str]:
        sides = [str(self.folder / side) for side in ("left", "right")]
        empty = [str(self.folder / f"empty-{side}") for side in ("left", "right")]
        return ["track", "--cameras", f"{self.folder}/cameras.toml", "--left", sides[0], "--right", sides[1],
                "--background", *empty, "--fps", "30", *map(str, more)]  # fmt: skip


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Film:
    folder = tmp_path_factory.mktemp("film")
    motion = sliced(on_stage(resampled(read_motion(MOTION / "boxing-05-neutral.bvh"), FPS)), 60, 100)
    source = simulated_source(motion, "boxing", Renderer(default_rig(), StudioSettings(clutter=False)), fps=FPS)
    names = [camera.name for camera in source.rig.cameras]
    for name in names:
        (folder / name).mkdir()
        (folder / f"empty-{name}").mkdir()
    for number, images in enumerate(source.background_frames(EMPTY)):
        for name, image in zip(names, images, strict=True):
            cv2.imwrite(f"{folder}/empty-{name}/{number:03d}.png", image)
    truth = []
    for frame in source:
        truth.append(frame.truth.markers_m)
        for name, image in zip(names, frame.images, strict=True):
            cv2.imwrite(f"{folder}/{name}/{frame.number:03d}.png", image)
    save_rig(source.rig, folder / "cameras.toml")
    save_subject(source.subject, folder / "subject.toml")
    write_bvh(source.motion, folder / "body.bvh")
    return Film(folder, np.array(truth))


@pytest.fixture(scope="module")
def bare(film) -> Path:
    """The film as a take without a performer."""
    path = film.folder / "bare.perftake"
    assert main(film.command("--marker-set", "boxing", "--out", path)) == 0
    return path


@pytest.fixture
def run(capsys):
    """run(*command) -> the summary."""
    return partial(commands.run, capsys)


@pytest.fixture
def refused(capsys):
    """refused(*command) -> the error's line."""

    def called(*command: object) -> str:
        capsys.readouterr()
        try:
            assert main([*map(str, command)]) == 1
        except SystemExit as wrong_usage:
            assert wrong_usage.code == 2
        shown = capsys.readouterr()
        assert shown.out == "" and "Traceback" not in shown.err
        return shown.err.strip().splitlines()[-1]

    return called


def right_share(take: MarkerTake, truth: np.ndarray) -> float:
    """Share of the located markers that are where the marker of their name is."""
    distance = np.linalg.norm(take.positions_m - truth, axis=2)
    return float(np.mean(distance[take.visible] < FAR_M))


def live(film: Film, database_file: Path):
    """Frames of the pipeline and poses of the session, as a live capture makes them."""
    source = open_image_source(film.folder / "left", film.folder / "right", fps=FPS)
    empty = open_image_source(film.folder / "empty-left", film.folder / "empty-right")
    rig = load_rig(film.folder / "cameras.toml")
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(empty.samples(EMPTY))
    session = Session(load_subject(film.folder / "subject.toml"), open_database(database_file), rig)
    frames = [pipeline.process(images) for images in source]
    return frames, [session.step(frame) for frame in frames]


def test_a_tracked_take_is_solved_as_live(film, bare, database_file, run, tmp_path):
    subject, known = film.folder / "subject.toml", tmp_path / "known.perftake"
    told = run(*film.command("--subject", subject, "--database", database_file, "--out", known))
    assert (told["frames"], told["markers"], told["lost_frames"]) == (40, 9, 0)
    assert told["visible_fraction"] > 0.9 and told["reprojection_rms_px"] < 0.5 and told["frames_per_s"] > 0
    frames, poses = live(film, database_file)
    body = ["--subject", subject, "--database", database_file]
    for take, options in ((known, []), (bare, body)):
        assert [pack(frame) for frame in read_take_file(take).frames] == [pack(frame) for frame in frames]
        solved = tmp_path / "solved.perftake"
        run("solve", take, *options, "--causal", "--out", solved)
        offline = [timed.pose.performers[0] for timed in read_take_file(solved).poses]
        for own, other in zip(offline, calm_performer(poses, noise_of(PointKind.MARKERS)), strict=True):
            assert (own.number, own.time_s, own.notes) == (other.number, other.time_s, other.notes)
            np.testing.assert_allclose(own.rotations, other.rotations, atol=1e-9)
            np.testing.assert_allclose(own.root_position_m, other.root_position_m, atol=1e-9)
            np.testing.assert_allclose(own.observed_m, other.observed_m, atol=1e-9)
            np.testing.assert_array_equal(own.single_cameras, other.single_cameras)
    assert read_take_file(known).setup.database == read_take_file(solved).setup.database
    assert read_take_file(solved).setup.subjects()[0].name == "simulated performer"
    assert not list(tmp_path.glob("*unfinished*"))


@pytest.mark.parametrize(
    ("name", "body"),
    [
        ("take.take.npz", ["--subject", "subject.toml"]),
        ("take.trc", ["--skeleton", "body.bvh", "--marker-set", "boxing"]),
    ],
)
def test_trajectories_have_the_labels_of_the_body(film, database_file, run, tmp_path, name, body):
    given = [film.folder / part if "." in part else part for part in body]
    told = run(*film.command(*given, "--database", database_file, "--out", tmp_path / name))
    assert told["labels"].startswith("found with the body") and told["warnings"] == []
    assert told["confidence"] > 0.5 and told["marker_rms_mm"] < 20.0
    take = read_take(tmp_path / name)
    assert list(take.names) == told["names"] and take.fps == FPS
    assert right_share(take, film.truth) >= 0.99
    assert told["visible_fraction"] == pytest.approx(take.visible.mean()) and take.visible.mean() > 0.9
    if take.single is not None:
        alone = np.argwhere(take.single.cameras >= 0)
        assert len(alone) and told["one_camera_fraction"] == pytest.approx(np.mean(take.single.cameras >= 0))
        for f, marker in alone:
            camera = take.single.rig.cameras[take.single.cameras[f, marker]]
            true = camera.undistort(camera.project(film.truth[f, marker][None]))[0]
            np.testing.assert_allclose(take.single.points[f, marker], true, atol=0.01)


def test_labels_without_a_body_are_guessed_and_said_to_be(film, run, tmp_path):
    told = run(*film.command("--marker-set", "boxing", "--out", tmp_path / "take.trc"))
    assert told["labels"] == "guessed without a body"
    assert told["warnings"] == ["labels are guessed without a body; name the performer and a motion database"]
    assert right_share(read_take(tmp_path / "take.trc"), film.truth) < 0.9  # 0.99 with a body


def test_a_take_without_a_performer_is_coped_with(film, bare, run, refused, tmp_path):
    part = tmp_path / "part.perftake"
    told = run(*film.command("--marker-set", "boxing", "--seconds", 0.1, "--out", part))
    assert (told["frames"], told["labels"]) == (3, "none: solving the take labels the markers")
    assert told["warnings"] == [
        "a .perftake without a performer stores no marker set: name the set when you solve the take"
    ]
    info = run("take", "info", bare)
    assert (info["frames"], info["complete"], info["poses"]) == (40, True, 0)
    assert (info["subject"], info["markers"]) == ("", None)
    assert "perfanim solve" in info["advice"][0] and "--subject" in info["advice"][0]
    listed = summarise(bare)
    assert (listed.complete, listed.frames, listed.performers, listed.marker_set) == (True, 40, (), "")
    for command in (
        ("take", "export", bare, "--out", tmp_path / "a.bvh"),
        ("take", "export", bare, "--out", tmp_path / "a.trc"),
        ("vmc", "send", bare),
        ("calibrate", "subject", bare, "--marker-set", "boxing", "--out", tmp_path / "a.toml"),
    ):
        assert "has no poses; solve it, which also labels its markers" in refused(*command)
    copy = tmp_path / "copy.perftake"
    assert run("take", "recover", bare, "--out", copy)["poses"] == 0
    assert read_take_file(copy).setup.performers == ()


@pytest.mark.long
def test_a_batch_labels_and_solves_a_take_without_a_performer(film, bare, database_file, run, capsys, tmp_path):
    body = ["--subject", film.folder / "subject.toml"]
    given = ["--database", database_file, "--jobs", 1, "--json"]
    (row,) = run("batch", bare, *body, *given, "--out", tmp_path / "solved")["takes"]
    assert row["figures"]["frames"] == 40 and Path(row["outputs"]["motion"]).is_file()
    assert main([*map(str, ["batch", bare, *given, "--out", tmp_path / "bad"])]) == 1
    (row,) = json.loads(capsys.readouterr().out)["takes"]
    assert row["reasons"] == ["names no performer; name a subject, or a skeleton and a marker set"]


def test_what_labels_need_is_told(film, database_file, refused, tmp_path):
    subject, body = film.folder / "subject.toml", film.folder / "body.bvh"
    out = ["--out", tmp_path / "take.trc"]
    take = ["--out", tmp_path / "take.perftake"]
    for more, reason in (
        (["--subject", subject, *out], "--database is required"),
        (["--database", database_file, *out], "needs --subject, or --skeleton and --marker-set"),
        (["--skeleton", body, "--database", database_file, *out], "a skeleton carries no markers; name the marker set"),
        (["--skeleton", body, "--subject", subject, *take], "not allowed with"),
        (["--subject", subject, "--database", tmp_path / "gone.pfdb", *out], "gone.pfdb: cannot be read"),
        (["--subject", tmp_path / "gone.toml", *take], "gone.toml: cannot be read"),
        (["--subject", subject, "--marker-set", "gone", *take], "there is no marker set or file 'gone'"),
        (["--truth", tmp_path / "truth.trc", *take], "--truth needs labels"),
        (["--floor", "feet", "--subject", subject, *take], "--floor feet needs labels"),
        (["--threshold", "250", *take], "perfanim: no markers were found; check the threshold"),
    ):
        assert reason in refused(*film.command(*more))
        assert not list(tmp_path.iterdir())


def test_what_a_solve_needs_is_told(film, bare, database_file, refused, tmp_path):
    subject, out = film.folder / "subject.toml", ["--out", tmp_path / "a.bvh"]
    assert "names no performer; name a subject" in refused("solve", bare, "--database", database_file, *out)
    assert "names no motion database; name one" in refused("solve", bare, "--subject", subject, *out)
    assert "gone.pfdb: cannot be read" in refused(
        "solve", bare, "--subject", subject, "--database", tmp_path / "gone.pfdb", *out
    )
    assert not list(tmp_path.iterdir())


def test_another_body_than_the_one_that_is_seen_is_told(film, database_file, run, refused, tmp_path):
    """Markers in a heap are no body: none is labelled, or none explained."""
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for number in range(20):
            picture = np.zeros((480, 640, 3), np.uint8)
            for row in range(3):
                cv2.circle(picture, (300 + 12 * row + number, 240), 3, (230, 230, 230), -1)
            cv2.imwrite(f"{tmp_path}/{side}/{number:03d}.png", picture)
    heap = Film(film.folder, film.truth).command()
    heap[4], heap[6] = str(tmp_path / "left"), str(tmp_path / "right")
    body = ["--subject", film.folder / "subject.toml", "--database", database_file]
    assert "no frame shows the body" in refused(*heap, *body, "--out", tmp_path / "take.trc")
    assert not (tmp_path / "take.trc").exists()

"""A person without markers in the jobs that watch cameras: with a replaced network, and what is told without one."""

import threading
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from filmed_people import POINTS, keypoints, moments, networks, write_film
from perfanim.core.errors import CaptureError
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.network_file import NETWORK_FILE, body_network_file
from perfanim.core.vision.people.people_pipeline import APART
from perfanim.core.vision.sources.source_requests import ImageFiles, VideoFiles
from perfanim.core.worker.jobs import camera_frames, check_setup, person_pipeline
from perfanim.core.worker.requests import CamerasRequest, CheckSetupRequest

COUNT = 40
RIG = default_rig()
SIDES = ("left", "right")


@pytest.fixture(scope="module")
def points_m(truth):
    return keypoints(truth)[:COUNT]


@pytest.fixture
def pictures(tmp_path):
    """Folders of both cameras with pictures that the replaced networks know by their first pixel."""
    for images in moments(RIG, COUNT):
        for side, image in zip(SIDES, images.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            assert cv2.imwrite(str(tmp_path / side / f"{images.number:03d}.png"), np.maximum(image, 0))
    return ImageFiles(tuple(str(tmp_path / side) for side in SIDES), fps=30.0)


@pytest.fixture
def nets(monkeypatch, points_m):
    """The networks that find the person in these pictures, in place of BlazePose."""
    made = networks(RIG, points_m)
    following = cycle(made)
    monkeypatch.setattr(person_pipeline, "BlazePose", lambda _path: next(following))
    return made


def run(job, request):
    """Return what a job sends: frames, pictures, texts of its state, warnings, and results."""
    sent = SimpleNamespace(frames=[], pictures=[], said=[], warnings=[], results=[])
    channel = SimpleNamespace(
        stop_requested=threading.Event(),
        slowness=SimpleNamespace(add=lambda *_: None),
        send_frame=lambda _stamp_s, frame: sent.frames.append(frame),
        send_preview=sent.pictures.append,
        send_status=lambda text, *_: sent.said.append(text),
        send_warning=sent.warnings.append,
        send_result=sent.results.append,
    )
    job.run(request, channel)
    return sent


def test_frames_have_the_labelled_points_of_the_person(nets, pictures, points_m):
    sent = run(camera_frames, CamerasRequest(source=pictures, rig=RIG, people="network", preview=True))
    assert len(sent.frames) == COUNT
    for frame, row in zip(sent.frames, points_m, strict=True):
        assert frame.labels.tolist() == list(range(len(POINTS)))
        np.testing.assert_allclose(frame.points_m, row, atol=1e-5)
        assert frame.notes == ()
    assert sent.said == ["opening the cameras", "waiting for images"]  # no background is learned
    assert all(net.calls > COUNT for net in nets)  # each camera has its own network
    greenest = sent.pictures[0].astype(int)
    assert np.count_nonzero(greenest[..., 1] - greenest[..., 0] > 100) > 100  # the skeleton's points


def test_one_camera_gives_rays_and_guesses_of_depth(nets, pictures, points_m):
    source, rig = ImageFiles(pictures.paths[:1], fps=30.0), CameraRig(RIG.cameras[:1], RIG.metadata)
    sent = run(camera_frames, CamerasRequest(source=source, rig=rig, people="network", preview=True))
    assert len(sent.frames) == COUNT and len(sent.pictures) > 0
    for frame, row in zip(sent.frames, points_m, strict=True):
        assert frame.labels.tolist() == frame.single_labels.tolist() == list(range(len(POINTS)))
        np.testing.assert_allclose(rig.cameras[0].project(frame.points_m), rig.cameras[0].project(row), atol=1e-3)
        assert frame.notes == ()


def test_one_camera_without_depths_gives_rays(nets, pictures):
    source, rig = ImageFiles(pictures.paths[:1], fps=30.0), CameraRig(RIG.cameras[:1], RIG.metadata)
    nets[0].points_m.clear()
    sent = run(camera_frames, CamerasRequest(source=source, rig=rig, people="network"))
    assert {(len(frame.points_m), len(frame.single_points)) for frame in sent.frames} == {(0, len(POINTS))}


def test_a_camera_without_a_person_is_told_with_each_frame(nets, pictures):
    nets[0].pixels.clear()
    sent = run(camera_frames, CamerasRequest(source=pictures, rig=RIG, people="network"))
    assert {frame.notes for frame in sent.frames} == {("the left camera shows nobody",)}


def test_a_cut_to_another_room_is_told(nets, pictures):
    """From the seventh moment on, the right camera shows a person who stands elsewhere."""
    for n in range(6, COUNT):
        pixels = nets[1].pixels[10 * n + 1]
        nets[1].pixels[10 * n + 1] = 0.7 * pixels + 0.3 * pixels.mean(axis=0) + (0.0, 60.0)
    sent = run(camera_frames, CamerasRequest(source=pictures, rig=RIG, people="network"))
    assert [APART in frame.notes for frame in sent.frames] == [False] * 6 + [True] * (COUNT - 6)


@pytest.mark.long
def test_videos_that_were_not_started_together_are_synchronised(nets, tmp_path, boxing):
    """The right video begins half a second after the left one."""
    points_m = keypoints(boxing)[:170]
    for net, whole in zip(nets, networks(RIG, points_m), strict=True):
        net.pixels = whole.pixels
    left = write_film(tmp_path / "left.avi", [10 * n for n in range(170)])
    right = write_film(tmp_path / "right.avi", [10 * n + 1 for n in range(15, 170)])
    source = VideoFiles((str(left), str(right)))
    sent = run(camera_frames, CamerasRequest(source=source, rig=RIG, people="network"))
    assert sent.said[0] == "synchronising the videos by the motion"
    assert len(sent.frames) == 155
    for frame, row in zip(sent.frames, points_m[15:], strict=True):
        np.testing.assert_allclose(frame.points_m, row, atol=1e-5)
    still = write_film(tmp_path / "still.avi", [1] * 155)
    asked = CamerasRequest(source=VideoFiles((str(left), str(still))), rig=RIG, people="network")
    with pytest.raises(CaptureError, match="when right began to film cannot be told from the motion that left shows"):
        run(camera_frames, asked)


@pytest.mark.parametrize(("content", "text"), [(None, "there is no body network"), (b"damaged", "is damaged, or not")])
def test_a_network_that_cannot_be_used_is_told_before_the_cameras_open(pictures, tmp_path, content, text):
    path = tmp_path / NETWORK_FILE
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaptureError, match=text):
        run(camera_frames, CamerasRequest(source=ImageFiles(("no", "folders")), rig=RIG, people=str(path)))


def test_cameras_that_are_not_calibrated_are_told(nets, pictures):
    with pytest.raises(CaptureError, match="the cameras are not calibrated; calibrate them first"):
        run(camera_frames, CamerasRequest(source=pictures, people="network"))


def test_the_check_finds_the_floor_under_the_feet(nets, pictures, monkeypatch, tmp_path, points_m):
    """The same cameras, whose heights and slopes are known or not."""
    monkeypatch.setattr(check_setup, "_SETTINGS", check_setup.CheckSettings(person_fps=30.0))
    monkeypatch.setattr(check_setup, "check_person", lambda _rig, _points, moments: list(moments)[:0])  # no faults
    asked = {"source": pictures, "people": "network", "marker_set": POINTS.name}
    (result,) = run(check_setup, CheckSetupRequest(**asked, rig=RIG, floor_out=str(tmp_path / "a.toml"))).results
    assert "calibration" not in result and not (tmp_path / "a.toml").exists()  # this rig knows it
    lost = in_first_cameras_world(RIG)
    (result,) = run(check_setup, CheckSetupRequest(**asked, rig=lost, floor_out=str(tmp_path / "b.toml"))).results
    assert result["calibration"] == str(tmp_path / "b.toml")
    found = load_rig(tmp_path / "b.toml")
    heights_m = [camera.centre_m[1] for camera in found.cameras]
    np.testing.assert_allclose(heights_m, [camera.centre_m[1] for camera in RIG.cameras], atol=0.05)


def in_first_cameras_world(rig):
    """Return the rig with its first camera as the world's origin, as it is calibrated before the floor is known."""
    first = rig.cameras[0]
    cameras = []
    for camera in rig.cameras:
        rotation = camera.rotation @ first.rotation.T @ WORLD_FROM_CAMERA.T
        translation_m = camera.translation_m - camera.rotation @ first.rotation.T @ first.translation_m
        cameras.append(replace(camera, rotation=rotation, translation_m=translation_m))
    return CameraRig(tuple(cameras))


def test_the_check_draws_the_person_and_names_the_fault(nets, pictures, monkeypatch):
    monkeypatch.setattr(check_setup, "_SETTINGS", check_setup.CheckSettings(person_fps=30.0))
    asked = {"source": pictures, "rig": RIG, "people": "network", "marker_set": POINTS.name}
    sent = run(check_setup, CheckSetupRequest(**asked))
    (result,) = sent.results
    assert [row["fault"] for row in result["findings"]] == ["too dark", "too dark"]  # these pictures are black
    assert "walk about" in sent.said
    nets[0].pixels.clear()
    (result,) = run(check_setup, CheckSetupRequest(**asked)).results
    assert [row["fault"] for row in result["findings"]] == ["nobody in view", "too dark"]


@pytest.mark.long
@pytest.mark.parametrize(("films", "faults"), [((1, 2), ["somebody else in view"]), ((0, 3), [])])
def test_the_check_tells_of_somebody_who_stands_behind_the_man_on_the_beam(shared_dir, films, faults):
    """A woman behind him is in the second camera's pictures, at the edge of the first's, and not in the others'."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    folder = shared_dir / "people" / "walk-on-beam"
    rig = load_rig(folder / "Calib.qca.txt")
    source = VideoFiles(tuple(str(folder / f"cam0{film + 1}.mp4") for film in films))
    some = CameraRig(tuple(rig.cameras[film] for film in films), rig.metadata)
    asked = {"source": source, "rig": some, "people": str(body_network_file()), "marker_set": POINTS.name}
    sent = run(check_setup, CheckSetupRequest(**asked))
    (result,) = sent.results
    assert [row["fault"] for row in result["findings"]] == faults
    assert "looking for others in the pictures" in sent.said
    if faults:
        (((camera, x, y),),) = [row["places"] for row in result["findings"]]
        assert camera == 0 and 760 < x < 840 and 500 < y < 900

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CaptureError, SettingsError
from perfanim.core.system import files
from perfanim.core.vision.sources.camera_source import CameraSource
from perfanim.core.vision.sources.image_file_source import ImageFileSource
from perfanim.core.vision.sources.image_header import check_image_size
from perfanim.core.vision.sources.source_kinds import open_image_source
from perfanim.core.vision.sources.video_source import VideoSource
from perfanim.core.worker.open_source import open_source


def video(path: Path, frames: int, fps: float = 25.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (64, 48))
    for number in range(frames):
        writer.write(np.full((48, 64, 3), 5 * number, np.uint8))
    writer.release()
    return path


def test_videos_are_read_frame_by_frame_and_again(tmp_path):
    paths = [video(tmp_path / name, 10) for name in ("left.avi", "right.avi")]
    source = VideoSource(paths)
    assert (source.frames, source.fps) == (10, 25.0)
    for _ in range(2):
        sets = list(source)
        assert [s.number for s in sets] == list(range(10))
        np.testing.assert_allclose([s.times_s[0] for s in sets], np.arange(10) / 25.0)
        assert abs(int(sets[7].images[1][20, 30, 0]) - 35) <= 2
    shown = [int(images[0][0, 0, 0]) for images in source.samples(4)]
    assert np.abs(np.array(shown) - [0, 15, 30, 45]).max() <= 2


def test_videos_that_were_not_started_together_come_one_by_one(tmp_path):
    paths = [video(tmp_path / "left.avi", 10, 25.0), video(tmp_path / "right.avi", 20, 30.0)]
    source = VideoSource(paths, together=False)
    assert source.is_apart and source.frames == 30
    sets = list(source)
    assert [images.number for images in sets] == list(range(30))
    shown = [images.usable.index(True) for images in sets]
    assert shown.count(0) == 10 and all(sum(images.usable) == 1 for images in sets)
    times_s = [images.times_s[camera] for images, camera in zip(sets, shown, strict=True)]
    assert times_s == sorted(times_s)
    assert max(abs(int(images.images[1 - camera].max())) for images, camera in zip(sets, shown, strict=True)) == 0
    assert not VideoSource([paths[0], video(tmp_path / "same.avi", 10)], together=False).is_apart


def test_videos_with_known_starts_are_paired_by_time(tmp_path):
    paths = [video(tmp_path / "left.avi", 40, 25.0), video(tmp_path / "right.avi", 30, 30.0)]
    source = VideoSource(paths, starts_s=(0.0, 0.4))
    sets = list(source)
    assert source.frames == len(sets) == 25 and all(images.usable == (True, True) for images in sets)
    assert min(images.times_s[0] for images in sets) == pytest.approx(0.4)
    for images in sets:
        assert abs(images.times_s[0] - images.times_s[1]) < 0.5 / 25.0
        number = round(30.0 * (images.times_s[1] - 0.4))
        assert abs(int(images.images[1][20, 30, 0]) - 5 * number) <= 3


def test_videos_of_different_length_are_refused_before_any_frame_is_read(tmp_path):
    paths = [video(tmp_path / "left.avi", 10), video(tmp_path / "right.avi", 7)]
    with pytest.raises(CaptureError, match=r"left\.avi 10 frames, right\.avi 7 frames"):
        VideoSource(paths)


def test_videos_of_two_rates_are_paired_in_time(tmp_path):
    """The slower video shows every second image of the other one."""
    left = video(tmp_path / "left.avi", 40)
    writer = cv2.VideoWriter(str(tmp_path / "right.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 12.5, (64, 48))
    for number in range(20):
        writer.write(np.full((48, 64, 3), 10 * number, np.uint8))
    writer.release()
    for paths in ((left, tmp_path / "right.avi"), (tmp_path / "right.avi", left)):
        source = VideoSource(paths)
        assert (source.frames, source.fps) == (20, 12.5)
        assert "left.avi 25" in source.warnings[0] and "right.avi 12.5" in source.warnings[0]
        sets = list(source)
        assert len(sets) == 20 and all(all(s.usable) for s in sets)
        for s in sets:
            assert s.times_s == pytest.approx((s.number / 12.5,) * 2)
            assert abs(int(s.images[0][0, 0, 0]) - int(s.images[1][0, 0, 0])) <= 2
        assert all(abs(int(a[0, 0, 0]) - int(b[0, 0, 0])) <= 2 for a, b in source.samples(5))
    with pytest.raises(CaptureError, match=r"short\.avi 15 frames in 1\.20 s"):
        VideoSource([left, video(tmp_path / "short.avi", 15, 12.5)])


def test_missing_and_broken_videos_are_named(tmp_path):
    good = video(tmp_path / "left.avi", 3)
    with pytest.raises(CaptureError, match=r"gone\.avi.*no such video"):
        VideoSource([good, tmp_path / "gone.avi"])
    (tmp_path / "text.avi").write_text("no video")
    with pytest.raises(CaptureError, match=r"text\.avi.*cannot be opened"):
        VideoSource([good, tmp_path / "text.avi"])


def test_film_in_a_codec_that_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "a.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (64, 48))
    for number in range(8):
        writer.write(np.full((48, 64, 3), 9 * number, np.uint8))
    writer.release()
    data = path.read_bytes()
    path.write_bytes(data.replace(b"mp4v", b"av01").replace(b"esds", b"free"))
    with pytest.raises(CaptureError, match=r"a.mp4: is a video in AV1, which cannot be read here; convert it to H.264"):
        next(iter(VideoSource([path])))


@pytest.mark.skipif(sys.platform == "win32", reason="has no pipes among its files")
@pytest.mark.parametrize(("name", "text"), [("x.mp4", "ffconcat version 1.0\nfile p.mp4\n"), ("concat:p.mp4", None)])
def test_pipe_is_refused_without_waiting(tmp_path, name, text):
    os.mkfifo(tmp_path / "p.mp4")
    if text is None:  # a good video, under a name that means another file to the reader
        (tmp_path / name).write_bytes(video(tmp_path / "a.avi", 3).read_bytes())
    else:
        (tmp_path / name).write_text(text)
    code = "import sys\nfrom perfanim.core.vision.sources.video_source import VideoSource\nVideoSource([sys.argv[1]])"
    done = subprocess.run(
        [sys.executable, "-c", code, name], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    last = (done.stderr.splitlines() or [""])[-1]
    assert (done.returncode, last) == (0, "") if text is None else "x.mp4: cannot be opened as a video" in last


LISTS = {
    "a.ffconcat": b"ffconcat version 1.0\nfile left.avi\n",
    "a.m3u8": b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nleft.avi\n#EXT-X-ENDLIST\n",
    "a.sdp": b"v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n",
    "a.mpd": b"<?xml version='1.0'?><MPD><BaseURL>left.avi</BaseURL></MPD>",
    "a.ts": b"G" * 188,
    "a.avi": b"RIFF\x10\0\0\0WAVEfmt ",
    "a.mp4": b"",
    "img%03d.png": b"\x89PNG\r\n\x1a\n",
}


@pytest.mark.parametrize("name", LISTS)
def test_files_that_do_not_begin_like_a_video_are_refused(tmp_path, monkeypatch, name):
    video(tmp_path / "left.avi", 3)
    (tmp_path / name).write_bytes(LISTS[name])
    monkeypatch.setattr(cv2, "VideoCapture", None)
    with pytest.raises(CaptureError, match=r"it does not begin like one.*not a playlist") as caught:
        VideoSource([tmp_path / name])
    assert str(caught.value).startswith(f"{tmp_path / name}: ")


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("a.mp4", "mp4v"), ("a.mov", "mp4v"), ("a.avi", "HFYU"), ("a.mkv", "HFYU"), ("a.webm", "VP80"),
        ("a.ts", "mp4v"), ("a.m2ts", "mp4v"), ("a.mpg", "MPG2"), ("a.wmv", "WMV2"), ("a.flv", "FLV1"),
        ("a.mxf", "MPG2"),
    ],
)  # fmt: skip
def test_videos_of_all_containers_are_read(tmp_path, monkeypatch, name, code):
    writer = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter.fourcc(*code), 25.0, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV does not write it")
    for number in range(5):
        writer.write(np.random.default_rng(number).integers(255, size=(48, 64, 3), dtype=np.uint8))
    writer.release()
    monkeypatch.chdir(tmp_path)  # names without a folder, too
    assert len(list(VideoSource([name, tmp_path / name]))) == 5


def test_closed_source_ends(tmp_path):
    source = VideoSource([video(tmp_path / "left.avi", 5)])
    seen = []
    for images in source:
        seen.append(images.number)
        source.close()
    assert seen == [0]


def test_camera_that_does_not_open_is_an_error(tmp_path, monkeypatch, capfd):
    (tmp_path / "97").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CaptureError, match=r"camera 97 does not open.*write \./97 for the file or folder"):
        CameraSource([97, 98])
    with pytest.raises(CaptureError, match="camera 1 is chosen more than once"):
        CameraSource([0, 1, 1])


def test_kind_of_source_is_recognised_by_its_text(tmp_path):
    clips = [str(video(tmp_path / name, 3)) for name in ("left.avi", "right.avi")]
    assert isinstance(open_image_source(*clips), VideoSource)
    for name in ("l", "r"):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "1.png"), np.zeros((4, 4, 3), np.uint8))
    folders = [str(tmp_path / "l"), str(tmp_path / "r")]
    assert isinstance(open_image_source(*folders, fps=12.0), ImageFileSource)
    with pytest.raises(CaptureError, match="different kinds"):
        open_image_source(clips[0], folders[1])
    with pytest.raises(CaptureError, match=r"nothing.*not found"):
        open_image_source(str(tmp_path / "nothing"), clips[1])
    with pytest.raises(CaptureError, match="camera 97"):
        open_image_source("97", "98")


def test_sources_are_opened_from_their_description(tmp_path):
    clips = [str(video(tmp_path / name, 3)) for name in ("left.avi", "right.avi")]
    assert isinstance(open_source({"kind": "videos", "paths": clips, "fps": 30}), VideoSource)
    with pytest.raises(SettingsError, match="source: kind must be one of simulated, videos, images, cameras, vmc"):
        open_source({"kind": "radio"})
    with pytest.raises(SettingsError, match="lacks 'paths'"):
        open_source({"kind": "images"})
    with pytest.raises(SettingsError, match=r"fps must be a number from 0\.1 to 1,000 frames per second"):
        open_source({"kind": "videos", "paths": clips, "fps": 0})


def test_simulated_performer_is_a_source():
    source = open_source({"kind": "simulated", "behaviour": "walk", "seconds": 3.0})
    first = next(iter(source))
    assert len(first.images) == 2 and first.images[0].shape == (480, 640, 3)
    source.close()


def test_small_video_of_huge_images_is_refused_before_decoding(tmp_path, monkeypatch):
    path = video(tmp_path / "a.avi", 3)
    check_image_size((64, 48), path.stat().st_size, "a")
    monkeypatch.setattr(files, "SLACK_BYTES", 9000 - 4 * path.stat().st_size)
    with pytest.raises(
        CaptureError, match=r"a\.avi: has 64 x 48 pixels, far more than its data can hold; use smaller images"
    ):
        VideoSource([path, path])

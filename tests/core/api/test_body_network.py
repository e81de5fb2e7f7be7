"""Getting the body network: from files and folders, with pip, and what is told if there is none."""

import subprocess
import sys
import time
import zipfile

import pytest
from perfanim.core.api.body_network import get_body_network
from perfanim.core.errors import CaptureError, DownloadError
from perfanim.core.system import pip_process
from perfanim.core.system.user_folder import cache_folder
from perfanim.core.vision.people import network_file
from perfanim.core.vision.people.network_file import NETWORK_FILE, body_network_file


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setattr(network_file, "cache_folder", lambda: tmp_path / "user")
    return tmp_path / "user"


def wheel(path, name=f"mediapipe/modules/pose_landmark/{NETWORK_FILE}", content=b"no network"):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, content)
    return path


@pytest.fixture
def real():
    path = cache_folder() / "networks" / NETWORK_FILE
    if not path.is_file():
        pytest.skip("the body network is not here: perfanim network get")
    return path


def test_a_network_comes_from_a_file_a_wheel_or_a_folder(real, tmp_path):
    wheels = tmp_path / "wheels"
    wheels.mkdir()
    packed = wheel(wheels / "mediapipe-0.10.14-any.whl", content=real.read_bytes())
    for source in (real, packed, wheels):
        assert get_body_network(source) == body_network_file()
        assert body_network_file().read_bytes() == real.read_bytes()
        body_network_file().unlink()


@pytest.fixture
def pip(monkeypatch, tmp_path):
    """pip("code") lets this code stand for pip; `wheel`, its folder and its arguments are known to it."""

    def use(code):
        script = tmp_path / "pip.py"
        script.write_text(
            f"import sys, time, zipfile\nargs = sys.argv[1:]\nfolder = args[args.index('--dest') + 1]\n{code}"
        )
        monkeypatch.setattr(pip_process, "pip_command", lambda: [sys.executable, str(script)])

    return use


def test_pip_brings_the_wheel(real, pip):
    packed = f"mediapipe/modules/pose_landmark/{NETWORK_FILE}"
    pip(f"zipfile.ZipFile(folder + '/mediapipe.whl', 'w').write({str(real)!r}, {packed!r})\ntime.sleep(1.0)")
    told = []
    assert get_body_network(progress=lambda share, text: told.append((share, text))).is_file()
    assert any(0.1 < share < 0.3 and text == "downloading the body network" for share, text in told)  # 6 MB of 35


def test_pip_ends_with_a_download_that_is_cancelled(pip, folder, tmp_path):
    pip(f"time.sleep(600)\nopen({str(tmp_path / 'late')!r}, 'w')")

    def cancel(share, text):
        if share == 0.0 and text == "downloading the body network":
            calls.append(time.monotonic())
        if len(calls) > 2:
            raise CaptureError("stopped")

    calls = []
    with pytest.raises(CaptureError, match="stopped"):
        get_body_network(progress=cancel)
    assert time.monotonic() - calls[0] < 300.0
    assert not folder.exists()


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda path: wheel(path / "a.whl"), CaptureError, "is damaged, or not the pose_landmark_full.tflite"),
        (lambda path: wheel(path / "a.whl", name="other.txt"), DownloadError, "holds no body network"),
        (lambda path: path, DownloadError, "holds no body network"),
        (lambda path: path / "missing.whl", DownloadError, "cannot be read"),
    ],
)
def test_what_is_no_network_is_told_and_nothing_is_written(tmp_path, folder, make, error, text):
    with pytest.raises(error, match=text):
        get_body_network(make(tmp_path))
    assert not folder.exists()


def test_why_pip_fails_is_told(pip, folder):
    pip("sys.stderr.write('WARNING: slow\\nERROR: no matching distribution found\\n')\nsys.exit(1)")
    with pytest.raises(DownloadError, match=r"pip does not bring mediapipe==0.10.14 \(ERROR: no matching distribution"):
        get_body_network()
    assert not folder.exists()


@pytest.mark.parametrize("is_installed", [True, False])
def test_pip_runs_where_it_is_not_installed(monkeypatch, is_installed):
    if not is_installed:  # as in Blender's own Python, which brings pip as a wheel
        monkeypatch.setattr(pip_process, "find_spec", lambda _: None)
    command = pip_process.pip_command()
    assert ("-m" in command) == is_installed
    said = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout
    assert said.startswith("pip ")

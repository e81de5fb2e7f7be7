"""The wheel and the sdist hold everything, and work where there is no checkout."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.system.assets import MOTION
from vicon_file import write_vicon_file

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("__init__.py", "core", "perfanim_addon", "assets", "pyproject.toml", "setup.py", "README.md", "LICENSE")
LIBRARIES = ("numpy", "cv2", "pythonosc", "tomli_w")
WALK = "walking-02-energetic"
SCRIPT = """
from pathlib import Path
import perfanim

home = Path(perfanim.__file__).parent
motion = [home / "assets" / "motion" / f"{name}.bvh" for name in ("walking-01-neutral", "walking-04-brisk")]
perfanim.build_database(motion, "motion.pfdb", perfanim.BuildSettings(fps=30.0, workers=1))
take, subject = perfanim.load_take("walk.c3d"), perfanim.load_subject("truth.bvh", "cmu-41")
perfanim.solve(take, subject, "motion.pfdb").save("p.bvh")
print(home)
"""


def built(folder: Path, kind: str, out: Path) -> Path:
    """Build a wheel or an sdist of a source folder, with the setuptools that is installed."""
    code = f"import setuptools.build_meta as backend; backend.build_{kind}({str(out)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return max(out.iterdir(), key=lambda path: path.stat().st_mtime_ns)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """What a fresh clone holds of the package, with little motion: builds leave folders behind."""
    folder = tmp_path_factory.mktemp("clone")
    left_out = shutil.ignore_patterns("__pycache__", "[!w]*.bvh", "performances")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=left_out)
        else:
            shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def wheel(sources, tmp_path_factory):
    return built(sources, "wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """The Python of a new environment with the wheel, and with the libraries that are installed here."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    program = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    install = [sys.executable, "-m", "pip", "--python", str(program), "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*install, str(wheel)], check=True)
    installed = next(folder.rglob("perfanim-*.dist-info")).parent
    homes = {str(Path(find_spec(name).origin).parents[1]) for name in LIBRARIES}
    (installed / "libraries.pth").write_text("\n".join(homes), encoding="utf-8")
    return program


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with nothing but a walker's take as Vicon writes it, and the true motion."""
    folder = tmp_path_factory.mktemp("elsewhere")
    walk = sliced(resampled(read_motion(MOTION / f"{WALK}.bvh"), 30.0), 20, 50)
    take, truth = simulate_markers(walk, load_marker_set("cmu-41"), noise_mm=1.0, seed=3)
    write_vicon_file(take, folder / "walk.c3d")
    write_bvh(truth, folder / "truth.bvh")
    return folder


def ran(program: Path, *arguments: str, folder: Path) -> str:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run([program, *arguments], cwd=folder, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_sdist_builds_the_same_wheel(sources, wheel, tmp_path):
    sdist = built(sources, "sdist", tmp_path)
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    again = built(next((tmp_path / "unpacked").iterdir()), "wheel", tmp_path)
    names = set(zipfile.ZipFile(wheel).namelist())
    assert names == set(zipfile.ZipFile(again).namelist())
    files = [path for part in ("core", "perfanim_addon", "assets") for path in (sources / part).rglob("*.*")]
    assert {f"perfanim/{path.relative_to(sources).as_posix()}" for path in files} <= names


@pytest.mark.long
def test_installed_python_and_command_solve_a_vicon_file(python, folder):
    where = Path(ran(python, "-c", SCRIPT, folder=folder).strip())
    assert where.is_relative_to(python.parents[1])
    perfanim = python.with_name("perfanim.exe" if os.name == "nt" else "perfanim")
    arguments = ("--database", "motion.pfdb", "--skeleton", "truth.bvh", "--marker-set", "auto", "--up", "auto")
    told = json.loads(ran(perfanim, "solve", "walk.c3d", *arguments, "--out", "c.bvh", "--json", folder=folder))
    assert (told["marker_set"], told["markers"], told["warnings"]) == ("cmu-41", 41, [])
    assert (folder / "c.bvh").read_bytes() == (folder / "p.bvh").read_bytes()
    measures = json.loads(ran(perfanim, "evaluate", "c.bvh", "--truth", "truth.bvh", "--json", folder=folder))
    assert measures["frames"] == 30
    assert measures["mpjpe_mm"] < 20.0

"""The examples of docs/scripting.md, as they stand there."""

import re
from pathlib import Path

import perfanim
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from vicon_file import write_vicon_file

GUIDE = Path(perfanim.__file__).parent / "docs" / "scripting.md"


@pytest.fixture
def folder(tmp_path, monkeypatch, embedded_motion, truth):
    """What the examples read, and nothing else: a little motion, a walker's take as Vicon writes it, and its truth."""
    (tmp_path / "motion").mkdir()
    walks = [motion for name, motion in embedded_motion.items() if name.startswith("walking") and name != truth.name]
    for motion in walks[:4]:
        write_bvh(sliced(motion, 0, 120), tmp_path / "motion" / f"{motion.name}.bvh")
    (tmp_path / "motion" / "broken.bvh").write_text("HIERARCHY")
    (tmp_path / "motion" / "golf-01.bvh").write_text("left out")
    walk = sliced(truth, 0, 30)
    subject = Subject("walker", walk.skeleton, load_marker_set("cmu-41"))
    write_vicon_file(simulate_markers(walk, subject, noise_mm=1.0, seed=3)[0], tmp_path / "walk.c3d")
    write_bvh(walk, tmp_path / "truth.bvh")
    save_subject(subject, tmp_path / "walker.toml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_examples_run_one_after_another(folder, capsys):
    examples = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(examples) == 4
    told = []
    for example in examples:
        exec(compile(example, str(GUIDE), "exec"), {"__name__": "__main__"})  # noqa: S102
        told.append(capsys.readouterr().out.splitlines())
    build, solve, live, compare = told
    assert len(build) == 2
    assert build[0].startswith("motion/broken.bvh was left out: ")
    assert re.fullmatch(r"960 frames, 8 clips, [2-8] bodies", build[1])  # four clips and their mirror images
    assert solve[0].startswith("30 frames, 100% of the markers seen, ")
    assert (
        solve[1].startswith("41 markers: ")
        and ":" not in solve[1].partition(": ")[2]
        and solve[1].endswith(" 0 warnings")
    )
    assert solve[2:] == ["the motion: good"]
    assert re.fullmatch(r"the last of 30 poses has a confidence of [01]\.\d\d", live[0])
    measures = evaluate(read_motion(folder / "walk.bvh"), read_motion(folder / "truth.bvh"))
    assert measures["frames"] == 30
    assert measures["mpjpe_mm"] < 15.0  # it stands upright
    assert compare[0] == f"{measures['deg_per_joint']:.2f} degrees a joint, {measures['mpjpe_mm']:.1f} mm"
    assert re.fullmatch(r"the left hand rises to \d\.\d\d m", compare[1])

"""Walks that the database does not hold, by CMU's own bones: the paper's method against the nearest example."""

import json

import pytest
from perfanim.core.cli.main import main

TAKES = ("16_16", "35_01")
DEG_PER_JOINT, BONE_DIRECTION = 0.85, 0.75  # of nearest's, at most


def run(capsys, *line: object) -> dict[str, object]:
    """Run a command as a user does and return what it tells."""
    capsys.readouterr()
    assert main([*map(str, line), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def database(cmu_dir, tmp_path_factory):
    """All of CMU that is there but the takes that are solved, 60 Hz."""
    path = tmp_path_factory.mktemp("cmu") / "held-out.db"
    excluded = [word for take in TAKES for word in ("--exclude", f"{take}*")]
    assert main(["database", "build", str(cmu_dir), *excluded, "--fps", "60", "--out", str(path)]) == 0
    return path


@pytest.mark.long
@pytest.mark.parametrize("take", TAKES)
def test_paper_beats_the_nearest_example_on_walks_out_of_the_database(take, cmu_dir, database, tmp_path, capsys):
    held = run(capsys, "database", "info", database)
    assert held["frames"] > 80_000
    assert held["fps"] == 60.0
    person = take.split("_")[0]
    truth, skeleton = cmu_dir / person / f"{take}.amc", cmu_dir / person / f"{person}.asf"
    markers = tmp_path / "markers.take.npz"
    run(
        capsys, "simulate", "markers", truth, "--skeleton", skeleton, "--marker-set", "boxing", "--fps", 60,
        "--out", markers,
    )  # fmt: skip
    figures = {}
    for method in ("nearest", "local-pca"):
        out = tmp_path / f"{method}.bvh"
        run(
            capsys, "solve", markers, "--database", database, "--skeleton", skeleton, "--marker-set", "boxing",
            "--method", method, "--out", out,
        )  # fmt: skip
        figures[method] = run(capsys, "evaluate", out, "--truth", truth, "--skeleton", skeleton)
    nearest, paper = figures["nearest"], figures["local-pca"]
    assert nearest["frames"] > 150
    assert paper["deg_per_joint"] <= DEG_PER_JOINT * nearest["deg_per_joint"]
    assert paper["bone_direction_deg"] <= BONE_DIRECTION * nearest["bone_direction_deg"]
    assert paper["mpjpe_mm"] < nearest["mpjpe_mm"]

import json

import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry.rig_file import load_rig


def board_file(path, noise: float = 0.05, moments: int = 12):
    """Board points as two cameras 0.3 m apart, 700 px focal length, see them."""
    from perfanim.core.geometry import rotations as rot

    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(8) * 30.0, np.arange(6) * 30.0), axis=-1).reshape(-1, 2)
    views: list[list] = [[], []]
    for _ in range(moments):
        turn = rot.to_matrix(rot.from_rotation_vector(rng.uniform(-0.5, 0.5, 3)))
        flat = np.column_stack((grid - grid.mean(axis=0), np.zeros(len(grid))))
        points = flat @ turn.T + [rng.uniform(0, 300), rng.uniform(-100, 100), rng.uniform(800, 1200)]
        for view, shift in zip(views, (0.0, 300.0), strict=True):
            moved = points - [shift, 0, 0]
            pixels = moved[:, :2] / moved[:, 2:] * 700.0 + [320.0, 240.0]
            view.append((pixels + rng.normal(0, noise, pixels.shape)).tolist())
    content = {
        "image_size": [640, 480],
        "board_points_mm": grid.tolist(),
        "image_points_cam1": views[0],
        "image_points_cam2": views[1],
    }
    path.write_text(json.dumps(content))
    return path


def test_cameras_are_calibrated_from_board_points(tmp_path, capsys):
    out = tmp_path / "cameras.toml"
    points = board_file(tmp_path / "points.json")
    assert main(["calibrate", "cameras", "--points", str(points), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert {"stereo_rms_px", "rms_px", "baseline_mm", "used", "rejected", "verdict", "advice"} <= set(summary)
    assert summary["baseline_mm"] == pytest.approx(300.0, rel=5e-3)
    assert summary["used"] == 12
    rig = load_rig(out)
    assert rig.baseline_m() == pytest.approx(summary["baseline_mm"] / 1000)
    np.testing.assert_allclose(rig.cameras[1].centre_m, [0.3, 0.0, 0.0], atol=0.01)


def test_videos_and_pictures_are_not_mixed(tmp_path, capsys):
    (tmp_path / "a.mp4").write_bytes(b"")
    arguments = ["--camera", f"a={tmp_path}/a.mp4", "--camera", "b=b/*.png", "--board", "chessboard:9x6:20mm"]
    assert main(["calibrate", "cameras", *arguments, "--out", str(tmp_path / "cameras.toml")]) == 1
    assert "a is a video and b is not" in capsys.readouterr().err


def test_board_is_written_as_pdf(tmp_path, capsys):
    out = tmp_path / "board.pdf"
    assert main(["calibrate", "board", "--spec", "chessboard:9x6:24mm", "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["paper"] == "A4"
    assert out.read_bytes().startswith(b"%PDF")

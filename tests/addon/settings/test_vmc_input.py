"""Trackers that another program sends by VMC in place of cameras: the settings, and a capture in Blender."""

import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from motion_synthesis import perform
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.simulate.simulated_markers import simulate_markers
from trackers_sent import Program, free_port, tracker_packet

PATIENCE_S = 300.0


def test_only_programs_of_this_computer_without_online_access(part: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen, told = bpy.context.scene.perfanim, bpy.context.scene.perfanim_receiving
    states, sending = part("settings.readiness"), part("settings.vmc_settings")
    chosen.source = "VMC"
    assert states.cameras(chosen).text == f"port {told.port}"  # no calibration is asked for
    assert "use an average body" in states.first_missing_step(chosen)
    assert not bpy.ops.perfanim.calibrate_performer.poll()
    assert part("capture.capture_request").cameras(chosen).to_json()["source"] == {
        "kind": "vmc",
        "port": 39540,
        "sender": "127.0.0.1",
    }
    for online, sender, ready in ((False, "192.168.1.7", False), (False, " ", False), (True, " ", True)):
        monkeypatch.setattr(sending, "is_online_allowed", lambda online=online: online)
        told.sender = sender
        assert states.cameras(chosen).ready is ready
        assert ("Online access" in states.first_missing_step(chosen)) is not ready


def test_trackers_move_the_character_and_a_sender_that_pauses_is_told(part: Any, tmp_path: Path) -> None:
    truth, marker_set = perform("walking", 3.0), load_marker_set("boxing")
    take, _ = simulate_markers(truth, marker_set)
    packets = [
        tracker_packet({name: place for name, place in zip(take.names, row, strict=True) if np.isfinite(place[0])})
        for row in take.positions_m
    ]
    write_bvh(truth, tmp_path / "walk.bvh")
    build_database([str(tmp_path / "walk.bvh")], tmp_path / "walk.pfdb", BuildSettings(fps=60.0))
    save_subject(Subject("Anna", truth.skeleton, marker_set), tmp_path / "anna.toml")
    chosen = bpy.context.scene.perfanim
    chosen.source, chosen.subject, chosen.database = "VMC", str(tmp_path / "anna.toml"), str(tmp_path / "walk.pfdb")
    chosen.marker_set = "boxing"
    bpy.context.scene.perfanim_receiving.port = free_port()
    assert part("settings.readiness").first_missing_step(chosen) == ""
    capture, limit_s = part("capture.live_capture").LiveCapture(None), time.monotonic() + PATIENCE_S
    sent: list[int] = []

    def go_on(condition: Any, frames: Any = ()) -> None:
        frames = iter(frames)
        while not condition():
            assert time.monotonic() < limit_s, capture.line
            for frame in frames:
                program.send(packets[frame])
                sent.append(frame)
                break
            capture.tick(bpy.context)
            assert not capture.done or condition(), capture.run.error
            time.sleep(1 / 60)

    with Program(bpy.context.scene.perfanim_receiving.port) as program:
        try:
            go_on(lambda: "waiting for trackers" in capture.line)
            go_on(lambda: "nothing arrives on port" in capture.run.notice)
            go_on(lambda: len(capture.run.poses) >= 40, range(120))
            go_on(lambda: "trackers no longer arrive" in capture.run.persistent_warning)
            paused = len(capture.run.poses)
            go_on(lambda: len(capture.run.poses) >= paused + 20, range(60, 180))
            armature = chosen.armature
            (pose,) = capture.run.poses[-1].performers
            bpy.context.view_layer.update()
            shown = {
                name: np.array(armature.pose.bones[NAMINGS["blender"][name]].head)
                for name in ("root", "lfoot", "rhand")
            }
            capture.stop()
            go_on(lambda: capture.done)
            text = capture.keep(bpy.context)
        finally:
            capture.close()
    assert any("the trackers are back" in warning for warning in capture.run.warnings)
    poses = [pose.performers[0] for pose in capture.run.poses]
    assert len(poses) == len(sent)
    assert f"{len(poses)} frames recorded" in text
    joints, _ = forward_kinematics(truth.skeleton, truth.rotations[sent], truth.root_positions_m[sent])
    solved, _ = forward_kinematics(
        truth.skeleton, np.stack([p.rotations for p in poses]), np.stack([p.root_position_m for p in poses])
    )
    assert 1000 * np.median(np.linalg.norm(solved - joints, axis=2)) < 20  # the very motion is in the database
    placed, _ = forward_kinematics(truth.skeleton, pose.rotations, pose.root_position_m)
    for name, head_m in shown.items():
        x, y, z = placed[truth.skeleton.index(name)]
        np.testing.assert_allclose(head_m, (x, -z, y), atol=1e-3)
    kept = read_take_file(part("take_library").listed()[0].path)
    assert kept.complete
    assert len(kept.frames) == len(kept.poses) == len(poses)
    assert kept.setup.camera_rig() is None
    told = " ".join(str(event) for event in kept.events)
    assert "nothing arrives on port" in told
    assert "not only bones" not in told  # the first packet after a silence is no sign of that
    assert np.diff([pose.number for pose in poses]).max() > 30  # the pause shows as numbers that are left out

"""Time offset of a camera, found in rendered images and used."""

import numpy as np
from motion_synthesis import perform
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import simulated_source
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.vision.tracked_take import synchronise_frames

FPS = 60.0


def p90_mm(frames, performance):
    """90th percentile of the distance of points to the nearest true marker."""
    errors = [
        1e3
        * np.linalg.norm(frame.points_m[:, None] - performance.markers_at([frame.time_s])[0][None], axis=-1).min(axis=1)
        for frame in frames
        if len(frame.points_m)
    ]
    return np.percentile(np.concatenate(errors), 90.0)


def test_delay_of_a_camera_is_found_in_rendered_images():
    late_s, rig = 0.006, default_rig()
    settings = StudioSettings(time_offsets_s=(0.0, late_s), exposure_s=0.004, noise_sigma=2.0)
    source = simulated_source(perform("jumping", 10.0), "boxing", Renderer(rig, settings))
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(source.background_frames(30))
    # as in a video: stamped by its number, whenever it was taken
    frames = [
        pipeline.process(ImageSet(number, (number / FPS, number / FPS), source.frame(number).images))
        for number in range(round(2.0 * FPS))
    ]
    moved, offsets = synchronise_frames(rig, frames)
    assert abs(offsets[1].offset_s - late_s) <= 0.001
    assert p90_mm(moved, source.performance) < p90_mm(frames, source.performance)

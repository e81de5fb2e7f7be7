"""Settings of the matching of blobs in space and time."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MatchingSettings:
    """How blobs are followed, moved in time and matched; sigmas are standard deviations."""

    # tracks, in an image 640 pixels wide, which a marker at 5 m/s crosses in less than a second
    gate_px: float = 6.0  # largest distance from the expected place,
    gate_px_s: float = 400.0  # and its growth with the time since the last image,
    new_px_s: float = 900.0  # also for a blob of unknown velocity
    longest_gap_s: float = 0.1  # then a track ends
    # moving blobs to one time
    remembered_images: int = 40  # two thirds of a second at 60 Hz
    nearest_images: int = 5  # in which a blob's track is searched for
    parabola_images: int = 3  # through which its parabola goes
    least_step_s: float = 0.001  # of the common moment when offsets change,
    largest_step_s: float = 0.25  # unless time goes back by more than this
    reach_periods: float = 1.0  # to the nearest image, beyond which a camera saw nothing
    # time offsets
    grid_step_s: float = 0.004
    grid_images: int = 600  # most images of the reference on the grid,
    offset_images: int = 6000  # and in the refinement
    most_px: float = 5.0  # larger distances all mean that blobs are different markers
    fewest_samples: int = 12  # of two tracks in common
    rounds: int = 4  # of choosing tracks and refining
    steps: int = 3  # of Gauss-Newton in a round
    difference_frames: float = 3.0  # each way, for velocities
    least_scale_px: float = 0.05  # of Cauchy's weights
    accepted: float = 3.0  # times the usual distance; tracks further apart are different markers
    drift_sigma: float = 1e-3  # clocks differ by less
    block_s: float = 0.5  # errors within such a time are correlated
    certain_s: float = 0.0005  # sigma of a certain offset; twice this is half a centimetre at 5 m/s,
    significant: float = 3.0  # and it is larger than this many sigmas
    # stereo
    epipolar_px: float = 4.0  # largest distance of a blob from the other's epipolar line,
    epipolar_sigmas: float = 3.0  # and the same in sigmas
    pixel_sigma: float = 0.5  # of a blob's centre, with calibration and time errors
    nearest_m: float = 0.3  # depths of markers
    farthest_m: float = 12.0
    spread_m: float = 0.5  # sigma of a marker's depth about the middle of all
    coherence_m: float = 0.06  # sigma of a marker's distance from its prediction
    most_coherence: float = 9.0  # largest cost of that distance, and of the depth
    hue_sigma: float = 25.0  # half degrees
    size_sigma: float = 0.35  # logarithm
    brightness_sigma: float = 0.6  # logarithm
    no_match: float = 30.0  # cost of a blob without a partner
    most_blobs: int = 150  # per camera, the brightest; the cost grows with their square, and with ghosts faster
    # exchanged cameras
    fewest_blobs: int = 4  # in each image
    swap_frames: int = 6  # whose mean counts: a quarter of a second at 30 Hz
    swap_px: float = 0.75  # mean error from which the exchanged order is tried
    swap_gain: float = 0.35  # error in the right order, relative to the wrong one
    # prediction of unlabelled points
    fastest_m_s: float = 12.0
    jitter_m: float = 0.05  # largest distance at rest
    forget_s: float = 0.5
    damping: float = 0.8  # of velocities


MATCHING = MatchingSettings()

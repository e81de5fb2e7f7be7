"""Settings for matching blobs in space and time."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MatchingSettings:
    """Settings for following blobs, moving them in time and matching them; sigmas are standard deviations."""

    # tracks; pixels are those of an image 640 pixels wide, which a marker at 5 m/s crosses in less than a second
    gate_px: float = 6.0  # largest distance from the expected position
    gate_px_s: float = 400.0  # growth of that distance with the time since the last image
    new_px_s: float = 900.0  # the same for a blob with unknown velocity
    longest_gap_s: float = 0.1  # gap that ends a track
    # moving blobs to one time
    remembered_images: int = 40  # images kept per camera: two thirds of a second at 60 Hz
    nearest_images: int = 5  # images in which a blob's track is searched for
    parabola_images: int = 3  # images that determine a blob's parabola
    least_step_s: float = 0.001  # smallest step of the common moment when offsets change
    largest_step_s: float = 0.25  # backward step of time above which alignment starts over
    reach_periods: float = 1.0  # largest distance in time of a usable image from the common moment, frame periods
    # time offsets
    grid_step_s: float = 0.004  # step between the offsets that are tried first
    grid_images: int = 600  # largest number of the reference's images on the grid
    offset_images: int = 6000  # largest number of the reference's images in the refinement
    most_px: float = 5.0  # distance above which blobs count as different markers
    fewest_samples: int = 12  # fewest images that two tracks must have in common
    rounds: int = 4  # repetitions of choosing tracks and refining
    steps: int = 3  # Gauss-Newton steps in a round
    difference_frames: float = 3.0  # half the interval for velocities, in frames
    least_scale_px: float = 0.05  # smallest scale of the Cauchy weights
    accepted: float = 3.0  # largest distance between tracks of one marker, as a multiple of the median distance
    drift_sigma: float = 1e-3  # standard deviation of the drift; real clocks differ by less
    block_s: float = 0.5  # time within which errors are correlated
    certain_s: float = 0.0005  # sigma below which an offset is certain; twice this is half a centimetre at 5 m/s
    significant: float = 3.0  # smallest offset that is corrected, in sigmas
    # stereo
    epipolar_px: float = 4.0  # largest distance of a blob from its partner's epipolar line
    epipolar_sigmas: float = 3.0  # the same distance in sigmas
    pixel_sigma: float = 0.5  # sigma of a blob's centre, including calibration and time errors
    nearest_m: float = 0.3  # smallest depth of a marker
    farthest_m: float = 12.0  # largest depth of a marker
    spread_m: float = 0.5  # sigma of a marker's depth about the mean depth
    coherence_m: float = 0.06  # sigma of a marker's distance from its prediction
    most_coherence: float = 9.0  # cap on the cost of that distance, and on the cost of the depth
    hue_sigma: float = 25.0  # sigma of the difference of a marker's hue between two cameras, half degrees
    size_sigma: float = 0.35  # the same for the logarithm of a marker's radius
    brightness_sigma: float = 0.6  # the same for the logarithm of a marker's brightness
    no_match: float = 30.0  # cost of a blob without a partner
    # largest number of blobs per camera, the brightest; the computing time grows with its square or more
    most_blobs: int = 150
    # exchanged cameras
    fewest_blobs: int = 4  # fewest blobs in an image for it to be tested
    swap_frames: int = 6  # images that are averaged: a quarter of a second at 30 Hz
    swap_px: float = 0.75  # mean error above which exchanged or flipped images are tried
    swap_gain: float = 0.35  # ratio of the errors with changed and unchanged images below which a fault is reported
    # prediction of unlabelled points
    fastest_m_s: float = 12.0  # largest speed of a marker
    jitter_m: float = 0.05  # largest motion of a resting marker from image to image
    forget_s: float = 0.5  # time for which a hidden point is predicted
    damping: float = 0.8  # share of the measured velocity that is used


MATCHING = MatchingSettings()

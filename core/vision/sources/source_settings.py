"""Settings of live cameras and videos."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SourceSettings:
    """Settings for reading and monitoring live cameras and combining their images; a period is one frame interval."""

    # reading
    warm_up_reads: int = 5  # attempts to get a first image
    held: int = 12  # largest number of waiting images per camera; the oldest are dropped
    poll_s: float = 0.02  # longest sleep of the reading loop
    retry_s: float = 0.01  # pause after a failed read
    gone_s: float = 0.1  # duration of failed reads after which a device is reopened
    reopen_s: float = 0.5  # pause between attempts to reopen a device
    all_lost_s: float = 10.0  # time without any image after which the source gives up
    never_usable_s: float = 5.0  # time without a usable image from one camera after which sampling gives up
    join_s: float = 0.5  # longest wait for a camera's thread to end
    same_clock_s: float = 1.0  # largest age of a time stamp for it to be on this computer's clock
    stream_opens_ms: int = 5000  # longest wait until a network camera opens
    stream_stalls_ms: int = 1000  # longest wait for a network camera's next image; then it is reconnected
    exposure_step: float = 1.5  # largest ratio of the requested and the actual exposure; drivers use steps of 2
    control_step: float = 1.0  # largest difference between a requested and an actual gain or focus, the camera's units
    # image sets
    together: float = 0.75  # largest distance in time within an image set, periods
    late: float = 0.25  # time after the start of the last set in which an image is too late for the next one, periods
    patience: float = 2.0  # longest wait for the other cameras' images, periods
    # videos
    other_rate: float = 1.2  # ratio of two videos' rates above which image sets follow the slower one's frames
    same_rate: float = 1.001  # largest ratio of the rates of videos that should have the same number of images
    end_frames: int = 2  # largest difference between the ends of videos, frames
    stamp_jitter: float = 0.25  # largest deviation of a video's time stamps from a steady rate, frames
    least_step: float = 0.05  # step between two images whose stamps do not ascend, frames
    # faults; the panel shows them within a quarter of a second
    silent_s: float = 0.12  # time without an image that counts as a fault
    silent_periods: float = 2.5  # the same in periods; the longer of the two applies
    stale_s: float = 0.1  # duration after which other faults are reported
    too_often: float = 0.6  # interval between images below which the rate is wrong, periods
    black_level: int = 24  # brightest grey level in a black image, above the noise of a covered sensor
    contrast: int = 2  # peak brightness that proves that a camera is not covered, as a multiple of the black level
    compared_rows: int = 16  # interval between the rows of pixels that are compared
    fresh_images: int = 60  # successive images without equal rows that prove a sensor's noise
    torn_rows: int = 4  # neighbouring rows equal to the previous image's that make an image torn
    tears: int = 2  # number of torn images that triggers a report
    tears_s: float = 0.5  # time within which these images must occur


SOURCES = SourceSettings()

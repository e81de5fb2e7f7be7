"""Settings of live cameras."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SourceSettings:
    """How live cameras are read, watched and their images put together; a period is that of the frame rate."""

    # reading
    warm_up_reads: int = 5  # tries for a first image
    held: int = 12  # images of a camera that wait; then the oldest are lost
    poll_s: float = 0.02  # at least so often, as a camera that gives nothing wakes nobody
    retry_s: float = 0.01  # after a failed read
    gone_s: float = 0.1  # of failed reads, then the device is opened again,
    reopen_s: float = 0.5  # and again
    all_lost_s: float = 10.0  # without any image, then the source gives up
    never_usable_s: float = 5.0  # without a usable image of one camera, while samples are taken
    join_s: float = 0.5  # longest wait for a camera at the end
    same_clock_s: float = 1.0  # largest age of a driver's time stamp that is of this computer's clock
    stream_opens_ms: int = 5000  # longest wait for a network camera,
    stream_stalls_ms: int = 1000  # and for its next image, then it is connected again
    exposure_step: float = 1.5  # largest ratio to an accepted exposure; drivers know steps of 2
    control_step: float = 1.0  # the same difference of gain and focus, in the camera's own numbers
    # image sets
    together: float = 0.75  # periods; images further apart belong to different moments
    late: float = 0.25  # periods after a set that was completed without it, in which an image is dropped
    patience: float = 2.0  # periods for which the other cameras' images are awaited
    # faults, reported within a quarter of a second on the panel
    silent_s: float = 0.12
    silent_periods: float = 2.5
    stale_s: float = 0.1  # duration of another fault
    too_often: float = 0.6  # periods between the images of a camera that runs at another rate
    black_level: int = 24  # grey levels, above the noise of a covered sensor
    contrast: int = 2  # a camera was not black before if it was this many times brighter
    compared_rows: int = 16  # one in so many rows of pixels is compared
    fresh_images: int = 60  # in a row without equal rows show a sensor's noise
    torn_rows: int = 4  # neighbouring compared rows that equal the last image's
    tears: int = 2  # torn images,
    tears_s: float = 0.5  # and the time within which they are reported


SOURCES = SourceSettings()

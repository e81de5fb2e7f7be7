"""Pipeline from images to marker frames with the labelled points of one person."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from ...body.foot_lock import floor_of
from ...geometry.arrays import Array, FloatArray, Image, IntArray, Mask
from ...geometry.camera import Camera, CameraRig
from ...geometry.triangulation import triangulate
from ...markers.marker_frame import MarkerFrame, undistort_blobs
from ...markers.marker_set import MarkerSet, load_marker_set
from ..pipeline import check_images
from ..sources.image_set import ImageSet, camera_title
from .body_network import BodyNetwork, FoundPerson
from .person_depth import AveragePerson, PersonDepth
from .person_follower import FollowSettings, PersonFollower, find_other
from .side_exchanges import SideExchanges


@dataclass(frozen=True)
class LocateSettings:
    """Settings of `PersonLocator`."""

    least_visible: float = 0.1  # probability of being visible below which a point is not used
    error_share: float = 0.012  # standard deviation of a point in a picture, in units of the crop's side
    contradiction: float = 6.0  # reprojection error, in standard deviations, above which two rays do not meet
    reweighted: int = 8  # number of times that the rays of three or more cameras are weighted by how well they meet
    depth_m: float = 0.15  # standard deviation of depths that a single camera shows
    nearest_m: float = 0.1  # depth up to which the network has guessed wrongly
    agreeing: float = 0.5  # share of the points of several cameras that must meet, or the cameras show different things


_S = LocateSettings()
_NOBODY = np.empty((0, 5), dtype=np.float32)
# note of a frame in which the rays of several cameras hardly meet
APART = "the cameras do not see the same person in the same place: check that one person is there and no camera moved"


class PeoplePipeline:
    """Finds one person in the images of a rig's cameras, and locates the network's points.

    Args:
        rig: Calibrated cameras.
        networks: A network for each camera.
        tries: Crops that are searched in each picture (see `PersonFollower`).
        others: Looks at the pictures of all cameras but the first meanwhile, each with its own network; None to look at
            them one after the other. OpenCV releases the interpreter while a network runs, so threads are enough.

    Attributes:
        points: The points that the networks find.
    """

    def __init__(
        self,
        rig: CameraRig,
        networks: Sequence[BodyNetwork],
        tries: int = FollowSettings().tries,
        others: Executor | None = None,
    ) -> None:
        self.rig, self.points = rig, load_marker_set(networks[0].marker_set)
        self._followers = [PersonFollower(network, tries) for network in networks]
        self._others = others
        self._locator = PersonLocator(rig, self.points)
        self._average = AveragePerson(self.points)

    def process(self, images: ImageSet) -> MarkerFrame:
        """Return the points of one image set: `detect`, then `PersonLocator.locate`."""
        return self._locator.locate(self.detect(images))

    def detect(self, images: ImageSet) -> MarkerFrame:
        """Return the points of the person in each image, as the rows of `MarkerFrame.blobs` in the network's order.

        A row's radius is the point's standard deviation, its brightness the probability that it is visible, its hue the
        distance along the camera's axis, metres, for a person of average size. An image without a person has no rows.

        Raises:
            CaptureError: The number or the size of the images does not match the calibration.
        """
        check_images(self.rig, images)
        found = self._find(images)
        names = [camera.name for camera in self.rig.cameras]
        nobody = tuple(
            f"{camera_title(index, names)} shows nobody"
            for index, (person, use) in enumerate(zip(found, images.usable, strict=True))
            if use and person is None
        )
        stamps_s = np.where(images.usable, images.times_s, np.nan)
        time_s = fmean(stamps_s[np.isfinite(stamps_s)].tolist() or images.times_s)
        return MarkerFrame(
            images.number,
            time_s,
            blobs=tuple(map(self._rows, self.rig.cameras, found)),
            camera_times_s=stamps_s,
            notes=(*images.notes, *nobody),
        )

    def others(self, images: ImageSet, seen: MarkerFrame) -> list[Array | None]:
        """Return for each image the points (K, 2) of somebody else than the followed person; None for nobody.

        This takes a hundred times as long as `detect`.

        Args:
            images: One image set.
            seen: What `detect` or `process` returned for it.
        """
        found = []
        for follower, image, rows in zip(self._followers, images.images, seen.detected, strict=True):
            other = find_other(follower.network, image, rows[:, :2].astype(np.float64)) if len(rows) else None
            found.append(other.pixels if other else None)
        return found

    def _rows(self, camera: Camera, person: FoundPerson | None) -> FloatArray:
        if person is None:
            return _NOBODY
        rows = np.zeros((len(person.pixels), 5), dtype=np.float32)
        rows[:, :2] = person.pixels
        rows[:, 2] = _S.error_share * person.crop.side_px
        rows[:, 3] = 255.0 * person.visibilities
        rows[:, 4] = self._average.depths_m(camera, person)
        return rows

    def _find(self, images: ImageSet) -> list[FoundPerson | None]:
        """Return the person in the image of each camera."""
        rows = list(zip(self._followers, images.images, images.usable, strict=True))
        if self._others is None:
            return [_step(*row) for row in rows]
        running = [self._others.submit(_step, *row) for row in rows[1:]]
        return [_step(*rows[0]), *(each.result() for each in running)]


def _step(follower: PersonFollower, image: Image, use: bool) -> FoundPerson | None:
    return follower.step(image) if use else None


class PersonLocator:
    """Locates a network's points in space, with left and right put right.

    If there is only one camera, the depths are guesses (see `PersonDepth`), and the points are rays as well.

    Args:
        rig: Calibrated cameras.
        points: The network's points, in its order.
    """

    def __init__(self, rig: CameraRig, points: MarkerSet) -> None:
        self._rig, self._count = rig, len(points)
        self._exchanges = SideExchanges(rig.cameras, points.markers)
        self._depth = PersonDepth(rig.cameras[0], points, floor_of(rig)) if len(rig) == 1 else None

    def locate(self, seen: MarkerFrame) -> MarkerFrame:
        """Return the labelled points of one moment from what `PeoplePipeline.detect` returned."""
        seen, normalised, sigmas_px = self._read(seen)
        return self._located(seen, normalised, sigmas_px, self._exchanges.step(seen.time_s, normalised))

    def locate_all(self, frames: Sequence[MarkerFrame]) -> list[MarkerFrame]:
        """Return the frames of a whole take located; left and right are decided with the moments after each, too."""
        read = [self._read(frame) for frame in frames]
        times_s, normalised = np.array([frame.time_s for frame in frames]), np.array([row for _, row, _ in read])
        rows_of = self._exchanges.decide_all(times_s, normalised)
        return [self._located(*each, rows) for each, rows in zip(read, rows_of, strict=True)]

    def _read(self, seen: MarkerFrame) -> tuple[MarkerFrame, Array, Array]:
        """Return a frame as detected, the visible points (C, K, 2) and their standard deviations (C, K), pixels."""
        notes = tuple(note for note in seen.notes if note != APART)
        seen = undistort_blobs(replace(seen, blobs=seen.detected, normalised=(), notes=notes), self._rig.cameras)
        normalised = np.full((len(self._rig), self._count, 2), np.nan)
        sigmas_px = np.ones(normalised.shape[:2])
        for camera, (rows, coordinates) in enumerate(zip(seen.blobs, seen.normalised, strict=True)):
            if len(rows) == self._count:
                visible = rows[:, 3] >= 255.0 * _S.least_visible
                normalised[camera, visible], sigmas_px[camera] = coordinates[visible], rows[:, 2]
        return seen, normalised, sigmas_px

    def _located(self, seen: MarkerFrame, normalised: Array, sigmas_px: Array, rows_of: IntArray) -> MarkerFrame:
        """Return the frame with the points whose rows (C, K) among the network's are known, -1 for wrong ones."""
        cameras = np.arange(len(self._rig))[:, None]
        wrong = np.count_nonzero((rows_of < 0) & np.isfinite(normalised[..., 0]))
        normalised, sigmas_px = normalised[cameras, rows_of].swapaxes(0, 1), sigmas_px[cameras, rows_of].T
        normalised[rows_of.T < 0] = np.nan
        is_seen = np.isfinite(normalised[..., 0])  # (K, C)
        several, alone = (np.flatnonzero(mask) for mask in (is_seen.sum(axis=1) >= 2, is_seen.sum(axis=1) == 1))
        points_m, covariances_m2, is_seen[several] = self._meet(
            normalised[several], sigmas_px[several], is_seen[several]
        )
        meets = is_seen[several].sum(axis=1) >= 2
        is_apart = meets.sum() < _S.agreeing * (len(several) + wrong)
        several = several[meets]
        cameras_alone = is_seen[alone].argmax(axis=1)
        located = replace(
            seen,
            points_m=points_m[meets],
            covariances_m2=covariances_m2[meets],
            labels=several,
            point_blobs=np.where(is_seen, rows_of.T, -1)[several],
            single_cameras=cameras_alone,
            single_blobs=rows_of.T[alone, cameras_alone],
            single_points=normalised[alone, cameras_alone],
            single_labels=alone,
            notes=(*seen.notes, APART) if is_apart else seen.notes,
        )
        return located if self._depth is None or not len(alone) else self._placed(located, self._depth)

    def _placed(self, seen: MarkerFrame, depth: PersonDepth) -> MarkerFrame:
        """Return a single camera's frame with its points in space as well."""
        depths_m = seen.blobs[0][seen.single_blobs, 4].astype(np.float64)
        ahead = depths_m > _S.nearest_m
        labels, rows = seen.single_labels[ahead], seen.single_blobs[ahead]
        points_m = depth.place(seen.time_s, labels, seen.single_points[ahead], depths_m[ahead])
        covariances_m2 = np.broadcast_to(_S.depth_m**2 * np.eye(3), (len(labels), 3, 3))
        return replace(seen, points_m=points_m, covariances_m2=covariances_m2, labels=labels, point_blobs=rows[:, None])

    def _meet(self, normalised: Array, sigmas_px: Array, is_seen: Mask) -> tuple[Array, Array, Mask]:
        """Return where rays (N, C, 2) meet (N, 3), the covariances, and which rays (N, C) meet there.

        Of three or more rays, those that miss the others count less (Cauchy's weights).
        """
        if len(is_seen) == 0:
            return np.empty((0, 3)), np.empty((0, 3, 3)), is_seen
        weights = np.where(is_seen, 1.0 / sigmas_px, 0.0)
        robust = is_seen.astype(np.float64)
        for _ in range(_S.reweighted if len(self._rig) > 2 else 1):
            shares = np.sqrt(robust)
            points_m, covariances_m2, errors = triangulate(self._rig.cameras, normalised, weights * shares, 1.0)
            errors = np.divide(errors, shares, out=errors, where=is_seen)
            robust = np.where(is_seen, 1.0 / (1.0 + errors**2), 0.0)
        return points_m, covariances_m2, is_seen & (errors < _S.contradiction)

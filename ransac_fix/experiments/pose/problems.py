"""A problem with its ground truth, and how far an estimate is from it."""

import zlib
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Kind = Literal["homography", "essential", "fundamental", "pnp"]

SAMPLE_SIZE: dict[Kind, int] = {"homography": 4, "essential": 5, "fundamental": 7, "pnp": 3}
LIMIT: dict[Kind, float] = {
    "homography": 3.0,
    "essential": 1.5,
    "fundamental": 1.5,
    "pnp": 3.0,
}
"""Largest distance of an inlier in pixels, where the data set says nothing else."""

NO_ESTIMATE = np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What a library returned.

    Parameters
    ----------
    model : ndarray or None
        A 3 x 3 homography or fundamental matrix, or a 3 x 4 pose (R, t); None where it failed.
    inliers : ndarray of bool, shape (n,)
        Its inliers among the measurements.
    """

    model: FloatArray | None
    inliers: NDArray[np.bool_]


class Truth(Protocol):
    """Ground truth of a problem."""

    @property
    def unit(self) -> str:
        """What errors are measured in."""

    def error(self, problem: "Problem", estimate: Estimate) -> float:
        """Return how far the estimate is, infinite where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Correspondences of one pair of images, or of an image and a scene.

    Parameters
    ----------
    kind : Kind
        What is estimated.
    dataset, name : str
        Where it comes from.
    first : ndarray of shape (n, 2)
        Points in the first image (in the only image for "pnp"), in pixels.
    second : ndarray of shape (n, 2), or (n, 3) for "pnp"
        Points in the second image, or in the scene.
    truth : Truth
        What an estimate is compared with.
    cameras : tuple of ndarray of shape (3, 3)
        Calibration matrices: none, one (pnp) or two.
    limit : float
        Largest distance of an inlier in pixels.
    """

    kind: Kind
    dataset: str
    name: str
    first: FloatArray
    second: FloatArray
    truth: Truth
    cameras: tuple[FloatArray, ...] = ()
    limit: float = 0.0

    def __post_init__(self) -> None:
        if self.limit == 0.0:
            object.__setattr__(self, "limit", LIMIT[self.kind])

    def subsample(self, n: int, seed: int, repeat: int) -> "Problem":
        """Return the problem with `n` of its correspondences, chosen uniformly.

        The choice depends on the arguments and the problem's name alone.

        Parameters
        ----------
        n : int
            At most as many as there are.
        seed, repeat : int
            Which of the choices, not negative.
        """
        identity = zlib.crc32(f"{self.kind} {self.dataset} {self.name}".encode())
        rng = np.random.default_rng([seed, identity, n, repeat])
        chosen = rng.choice(len(self.first), n, replace=False)
        return replace(
            self,
            first=np.ascontiguousarray(self.first[chosen]),
            second=np.ascontiguousarray(self.second[chosen]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """The true motion between two calibrated cameras, x2 ~ K2 (R X + t).

    The error is the larger of the angles between the rotations and between the directions of
    the translations, in degrees. A fundamental matrix is turned into a pose by the true
    calibration and its inliers, a homography into the nearest of its decompositions.
    """

    rotation: FloatArray
    translation: FloatArray

    @property
    def unit(self) -> str:
        """Degrees."""
        return "degrees"

    def error(self, problem: Problem, estimate: Estimate) -> float:
        """Return the pose error in degrees."""
        poses: list[FloatArray] = []
        if estimate.model is None or not np.isfinite(estimate.model).all():
            return NO_ESTIMATE
        if problem.kind == "essential":
            poses = [estimate.model]
        elif problem.kind == "fundamental":
            pose = pose_of_fundamental(problem, estimate)
            poses = [] if pose is None else [pose]
        elif problem.kind == "homography":
            first, second = problem.cameras
            normalised = np.linalg.inv(second) @ estimate.model @ first
            _, rotations, translations, _ = cv2.decomposeHomographyMat(normalised, np.eye(3))
            poses = [np.column_stack(pair) for pair in zip(rotations, translations, strict=True)]
        return min((self._distance(pose) for pose in poses), default=NO_ESTIMATE)

    def _distance(self, pose: FloatArray) -> float:
        turned = rotation_angle(self.rotation, pose[:, :3])
        return max(turned, angle_between(self.translation, pose[:, 3]))


@dataclass(frozen=True, slots=True, eq=False)
class AbsolutePose:
    """The true pose of a camera, x ~ K (R X + t).

    The error is the larger of the rotation error in degrees and the distance of the camera's
    centre in percent of the scene's median depth.
    """

    rotation: FloatArray
    translation: FloatArray
    depth: float

    @property
    def unit(self) -> str:
        """Degrees or percent, whichever is larger."""
        return "degrees or percent of depth"

    def error(self, problem: Problem, estimate: Estimate) -> float:  # noqa: ARG002
        """Return the pose error in degrees or percent, whichever is larger."""
        if estimate.model is None or not np.isfinite(estimate.model).all():
            return NO_ESTIMATE
        rotation, translation = estimate.model[:, :3], estimate.model[:, 3]
        moved = -rotation.T @ translation + self.rotation.T @ self.translation
        shift = 100 * float(np.linalg.norm(moved)) / self.depth
        return max(rotation_angle(self.rotation, rotation), shift)


@dataclass(frozen=True, slots=True, eq=False)
class CorrespondingPoints:
    """True correspondences: the error is their mean distance from the estimate in pixels.

    For a homography the distance of the mapped first point from the second, for a fundamental
    matrix Sampson's.
    """

    first: FloatArray
    second: FloatArray

    @property
    def unit(self) -> str:
        """Pixels."""
        return "pixels"

    def error(self, problem: Problem, estimate: Estimate) -> float:
        """Return the mean distance in pixels."""
        if estimate.model is None or not np.isfinite(estimate.model).all():
            return NO_ESTIMATE
        distance = transfer_distances if problem.kind == "homography" else sampson_distances
        error = float(distance(estimate.model, self.first, self.second).mean())
        return error if np.isfinite(error) else NO_ESTIMATE


def rotation_angle(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two rotations, shape (3, 3), in degrees, 0 to 180."""
    # By the chord, which keeps its digits at small angles where the cosine does not.
    chord = float(np.linalg.norm(first - second)) / (2 * np.sqrt(2))
    return float(np.degrees(2 * np.arcsin(min(1.0, chord))))


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two directions, of three entries each, in degrees.

    It is 180 where one has no length.
    """
    lengths = float(np.linalg.norm(first)) * float(np.linalg.norm(second))
    if lengths == 0.0:
        return 180.0
    cross = float(np.linalg.norm(np.cross(first.ravel(), second.ravel())))
    return float(np.degrees(np.arctan2(cross, float(first.ravel() @ second.ravel()))))


def transfer_distances(homography: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distances of mapped first points from second ones, shape (n,), in pixels.

    Parameters
    ----------
    homography : ndarray of shape (3, 3)
        From the first image to the second.
    first, second : ndarray of shape (n, 2)
        Corresponding points in pixels.
    """
    mapped = np.column_stack((first, np.ones(len(first)))) @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        distances: FloatArray = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - second, axis=1)
    return distances


def sampson_distances(fundamental: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return Sampson's distances from the epipolar geometry, shape (n,), in pixels.

    Parameters
    ----------
    fundamental : ndarray of shape (3, 3)
        F with ``(x2, 1) F (x1, 1) = 0``.
    first, second : ndarray of shape (n, 2)
        Corresponding points in pixels.
    """
    one = np.ones(len(first))
    x1, x2 = np.column_stack((first, one)), np.column_stack((second, one))
    lines2, lines1 = x1 @ fundamental.T, x2 @ fundamental
    squares = (lines2[:, :2] ** 2).sum(axis=1) + (lines1[:, :2] ** 2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distances: FloatArray = np.abs((x2 * lines2).sum(axis=1)) / np.sqrt(squares)
    return distances


def pose_of_fundamental(problem: Problem, estimate: Estimate) -> FloatArray | None:
    """Return the 3 x 4 pose in which most inliers lie before both cameras; None without five."""
    if estimate.model is None or estimate.inliers.sum() < 5:
        return None
    first, second = problem.cameras
    essential = second.T @ estimate.model @ first
    x1 = normalised(problem.first[estimate.inliers], first)
    x2 = normalised(problem.second[estimate.inliers], second)
    _, rotation, translation, _ = cv2.recoverPose(essential, x1, x2)
    pose: FloatArray = np.column_stack((rotation, translation))
    return pose


def normalised(points: FloatArray, camera: FloatArray) -> FloatArray:
    """Return image points in the units of a camera with focal length 1, shape (n, 2).

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        In pixels.
    camera : ndarray of shape (3, 3)
        Its calibration matrix.
    """
    rays = np.linalg.solve(camera, np.column_stack((points, np.ones(len(points)))).T)
    return np.ascontiguousarray(rays[:2].T)

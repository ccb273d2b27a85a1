"""The libraries, bare, run for a given number of trials.

Every library stops when a budget of trials is spent, so any stopping rule can be had from an
unchanged one: the budget at which the rule is first met is found (`stopping.py`), and the run
with that budget is the run under that rule, on the same samples.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import poselib
import pycolmap

from ransac_fix.experiments.pose.problems import (
    SAMPLE_SIZE,
    Estimate,
    FloatArray,
    Kind,
    Problem,
    normalised,
)

# OpenCV's own rule cannot be switched off; at the largest confidence below 1 it asks for eight
# times the trials that 0.99 asks for. A budget beyond those cannot be had from it.
_OPENCV_CONFIDENCE = float(np.nextafter(1.0, 0.0))


@dataclass(frozen=True, slots=True)
class Library:
    """One library.

    Parameters
    ----------
    name, version : str
        The system's name, and the installed version.
    run : callable
        Runs a problem for a number of trials on the random stream of a seed.
    bare : callable
        Runs a problem under the library's own rule at a confidence, its limits on the trials
        taken away as far as it allows, and its multiplier 1.
    sample_size : dict
        k of its rule for each kind of problem.
    reaches : callable
        Whether a number of trials can be had from it at all, given the number of inliers.
    """

    name: str
    version: str
    run: Callable[[Problem, int, int], Estimate]
    bare: Callable[[Problem, float, int, int], Estimate]
    sample_size: dict[Kind, int]
    reaches: Callable[[int, int, int, int], bool]


def _always(trials: int, n_inliers: int, n_samples: int, sample_size: int) -> bool:  # noqa: ARG001
    return True


def _poselib(problem: Problem, options: dict[str, float | int]) -> Estimate:
    options = {
        "max_epipolar_error": problem.limit,
        "max_reproj_error": problem.limit,
        "dyn_num_trials_mult": 1.0,
        **options,
    }
    first, second = problem.first, problem.second
    if problem.kind == "homography":
        model, info = poselib.estimate_homography(first, second, options, {})
    elif problem.kind == "fundamental":
        model, info = poselib.estimate_fundamental(first, second, options, {})
    elif problem.kind == "essential":
        cameras = [_poselib_camera(camera) for camera in problem.cameras]
        pose, info = poselib.estimate_relative_pose(first, second, *cameras, options, {})
        model = np.column_stack((pose.R, pose.t))
    else:
        camera = _poselib_camera(problem.cameras[0])
        pose, info = poselib.estimate_absolute_pose(first, second, camera, options, {})
        model = np.column_stack((pose.R, pose.t))
    return Estimate(np.asarray(model), np.asarray(info["inliers"], bool))


def _poselib_run(problem: Problem, trials: int, seed: int) -> Estimate:
    return _poselib(problem, {"min_iterations": trials, "max_iterations": trials, "seed": seed})


def _poselib_bare(problem: Problem, confidence: float, seed: int, most: int) -> Estimate:
    return _poselib(
        problem,
        {"min_iterations": 0, "max_iterations": most, "success_prob": confidence, "seed": seed},
    )


def _poselib_camera(camera: FloatArray) -> dict[str, object]:
    return {
        "model": "PINHOLE",
        "width": int(np.ceil(2 * camera[0, 2])),
        "height": int(np.ceil(2 * camera[1, 2])),
        "params": [camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]],
    }


def _opencv(problem: Problem, trials: int, confidence: float) -> Estimate:
    first, second, limit = problem.first, problem.second, problem.limit
    if problem.kind == "homography":
        model, mask = cv2.findHomography(
            first, second, cv2.RANSAC, limit, maxIters=trials, confidence=confidence
        )
    elif problem.kind == "fundamental":
        model, mask = cv2.findFundamentalMat(
            first, second, cv2.FM_RANSAC, limit, confidence, trials
        )
    elif problem.kind == "essential":
        return _opencv_essential(problem, trials, confidence)
    else:
        return _opencv_pnp(problem, trials, confidence)
    if model is None or mask is None or model.shape != (3, 3):
        return _failed(problem)
    return Estimate(model, mask.ravel() > 0)


def _opencv_essential(problem: Problem, trials: int, confidence: float) -> Estimate:
    camera1, camera2 = problem.cameras
    x1, x2 = normalised(problem.first, camera1), normalised(problem.second, camera2)
    focal = float(np.mean([camera1[0, 0], camera1[1, 1], camera2[0, 0], camera2[1, 1]]))
    essential, mask = cv2.findEssentialMat(
        x1,
        x2,
        np.eye(3),
        method=cv2.RANSAC,
        prob=confidence,
        threshold=problem.limit / focal,
        maxIters=trials,
    )
    if essential is None or mask is None or essential.shape[0] < 3:
        return _failed(problem)
    inliers = mask.ravel() > 0
    _, rotation, translation, _ = cv2.recoverPose(essential[:3], x1[inliers], x2[inliers])
    return Estimate(np.column_stack((rotation, translation)), inliers)


def _opencv_pnp(problem: Problem, trials: int, confidence: float) -> Estimate:
    found, rotation, translation, indices = cv2.solvePnPRansac(
        problem.second,
        problem.first,
        problem.cameras[0],
        np.zeros(4),
        iterationsCount=trials,
        reprojectionError=problem.limit,
        confidence=confidence,
        flags=cv2.SOLVEPNP_P3P,
    )
    if not found or indices is None:
        return _failed(problem)
    inliers = np.zeros(len(problem.first), bool)
    inliers[indices.ravel()] = True
    return Estimate(np.column_stack((cv2.Rodrigues(rotation)[0], translation)), inliers)


def _opencv_run(problem: Problem, trials: int, seed: int) -> Estimate:  # noqa: ARG001
    # Its generator starts the same at every call, so the seed is that of the subsample.
    return _opencv(problem, trials, _OPENCV_CONFIDENCE)


def _opencv_bare(problem: Problem, confidence: float, seed: int, most: int) -> Estimate:  # noqa: ARG001
    return _opencv(problem, most, confidence)


def _opencv_reaches(trials: int, n_inliers: int, n_samples: int, sample_size: int) -> bool:
    from ransac_fix.criterion import approximate_required_trials

    # OpenCV rounds to the nearest, hence one less.
    return trials < approximate_required_trials(
        n_inliers, n_samples, sample_size, _OPENCV_CONFIDENCE
    )


def _pycolmap(problem: Problem, ransac: pycolmap.RANSACOptions) -> Estimate:
    ransac.max_error = problem.limit
    ransac.dyn_num_trials_multiplier = 1.0
    first, second = problem.first, problem.second
    if problem.kind == "homography":
        found = pycolmap.estimate_homography_matrix(first, second, ransac)
        model = None if found is None else found["H"]
    elif problem.kind == "fundamental":
        found = pycolmap.estimate_fundamental_matrix(first, second, ransac)
        model = None if found is None else found["F"]
    elif problem.kind == "essential":
        cameras = [_pycolmap_camera(camera) for camera in problem.cameras]
        found = pycolmap.estimate_essential_matrix(first, second, *cameras, ransac)
        model = None if found is None else found["cam2_from_cam1"].matrix()
    else:
        options = pycolmap.AbsolutePoseEstimationOptions()
        options.ransac = ransac
        camera = _pycolmap_camera(problem.cameras[0])
        found = pycolmap.estimate_and_refine_absolute_pose(first, second, camera, options)
        model = None if found is None else found["cam_from_world"].matrix()
    if found is None or model is None:
        return _failed(problem)
    return Estimate(np.asarray(model), np.asarray(found["inlier_mask"], bool))


def _pycolmap_run(problem: Problem, trials: int, seed: int) -> Estimate:
    ransac = pycolmap.RANSACOptions()
    ransac.min_num_trials = ransac.max_num_trials = trials
    ransac.random_seed = seed
    return _pycolmap(problem, ransac)


def _pycolmap_bare(problem: Problem, confidence: float, seed: int, most: int) -> Estimate:
    ransac = pycolmap.RANSACOptions()
    ransac.min_num_trials, ransac.max_num_trials = 0, most
    ransac.confidence = confidence
    ransac.random_seed = seed
    return _pycolmap(problem, ransac)


def _pycolmap_camera(camera: FloatArray) -> pycolmap.Camera:
    return pycolmap.Camera(
        model="PINHOLE",
        width=int(np.ceil(2 * camera[0, 2])),
        height=int(np.ceil(2 * camera[1, 2])),
        params=[camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]],
    )


def _failed(problem: Problem) -> Estimate:
    return Estimate(None, np.zeros(len(problem.first), bool))


LIBRARIES = {
    "poselib": Library(
        "poselib", poselib.__version__, _poselib_run, _poselib_bare, SAMPLE_SIZE, _always
    ),
    "opencv": Library(
        "opencv",
        cv2.__version__,
        _opencv_run,
        _opencv_bare,
        {**SAMPLE_SIZE, "pnp": 4},
        _opencv_reaches,
    ),
    "colmap": Library(
        "colmap", pycolmap.__version__, _pycolmap_run, _pycolmap_bare, SAMPLE_SIZE, _always
    ),
}

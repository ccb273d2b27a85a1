"""Real correspondences: the project's folder of arrays, the PoseLib benchmark, a stereo pair."""

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.pose.problems import (
    AbsolutePose,
    CorrespondingPoints,
    FloatArray,
    Kind,
    Problem,
    RelativePose,
    sampson_distances,
    transfer_distances,
)

# What a file that is damaged, or of another layout, raises.
_UNREADABLE = (OSError, EOFError, zipfile.BadZipFile, KeyError, IndexError, ValueError)
# Pairs with fewer inliers are chance hits of views that do not overlap.
_FEWEST_INLIERS = 12

# Inlier distances of the PoseLib benchmark in pixels, by the start of a file's name.
_BENCHMARK_LIMITS = {
    "megadepth1500": 1.0,
    "scannet1500_sift": 1.5,
    "scannet1500_spsg": 1.5,
    "scannet1500": 2.5,
    "imc": 0.75,
    "barath": 1.0,
    "eth3d": 12.0,
    "7scenes": 5.0,
    "cambridge": 6.0,
}
# COLMAP's camera models and their parameters, in order.
_PARAMETERS = {
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_PINHOLE": "f cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
}
_UNDISTORTIONS = 50
# The benchmark takes the first pairs only of its large homography files.
_MOST_HOMOGRAPHIES = 1000


def load_problems(folder: Path) -> list[Problem]:
    """Return all problems of a folder, in either of the two layouts.

    Parameters
    ----------
    folder : Path
        Either the project's layout (``sift/*.npz``, ``annotated/homography/*_pts.txt``,
        ``annotated/fundamental/*_pts.txt``) or the PoseLib benchmark's (``relative/*.h5``,
        ``absolute/*.h5``, ``homography/*.h5``).

    Raises
    ------
    RansacFixError
        When the folder holds neither, or a file does not have the layout.
    """
    if not folder.is_dir():
        raise RansacFixError(f"{folder}: no such folder")
    problems = [*_from_arrays(folder), *_from_benchmark(folder)]
    if not problems:
        raise RansacFixError(
            f"{folder}: neither sift/*.npz nor annotated/*/*_pts.txt nor the PoseLib benchmark's"
            " relative/*.h5, absolute/*.h5 or homography/*.h5"
        )
    return problems


def _from_arrays(folder: Path) -> Iterator[Problem]:
    for path in sorted((folder / "sift").glob("*.npz")):
        if path.name.startswith("reg3d_"):  # 3D-3D registration is not among the paper's tables
            continue
        try:
            with np.load(path) as file:
                pairs = {name: (file[name], file[f"{name}__gt"]) for name in _pair_names(file)}
            for name, (rows, truth) in pairs.items():
                yield from _from_rows(path.stem, name, rows, truth)
        except _UNREADABLE as error:
            raise RansacFixError(
                f"{path}: not correspondences with ground truth: {error}"
            ) from None
    for path in sorted((folder / "annotated" / "homography").glob("*_pts.txt")):
        yield from _annotated(path, "homography")
    for path in sorted((folder / "annotated" / "fundamental").glob("*_pts.txt")):
        yield from _annotated(path, "fundamental")


def _pair_names(file: "np.lib.npyio.NpzFile") -> list[str]:
    return [name for name in file.files if not name.endswith("__gt")]


def _from_rows(dataset: str, name: str, rows: FloatArray, truth: FloatArray) -> Iterator[Problem]:
    truth = truth.astype(float).ravel()
    first = np.ascontiguousarray(rows[:, :2], float)
    if len(truth) == 9:  # a homography: judged on the pair's true correspondences
        second = np.ascontiguousarray(rows[:, 2:4], float)
        homography = truth.reshape(3, 3)
        good = transfer_distances(homography, first, second) < 3.0
        if good.sum() >= _FEWEST_INLIERS:
            mapped = np.column_stack((first[good], np.ones(good.sum()))) @ homography.T
            points = CorrespondingPoints(first[good], mapped[:, :2] / mapped[:, 2:])
            yield Problem("homography", dataset, name, first, second, points)
    elif len(truth) == 21:
        points3d = np.ascontiguousarray(rows[:, 2:5], float)
        camera, rotation, translation = np.split(truth, (9, 18))
        camera, rotation = camera.reshape(3, 3), rotation.reshape(3, 3)
        seen = points3d @ rotation.T + translation
        projected = seen @ camera.T
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.linalg.norm(projected[:, :2] / projected[:, 2:] - first, axis=1)
        good = (off < 3.0) & (seen[:, 2] > 0)
        if good.sum() >= _FEWEST_INLIERS:
            depth = float(np.median(seen[good, 2]))
            pose = AbsolutePose(rotation, translation, depth)
            yield Problem("pnp", dataset, name, first, points3d, pose, (camera,))
    elif len(truth) == 30:
        second = np.ascontiguousarray(rows[:, 2:4], float)
        first_camera, second_camera, rotation = truth[:27].reshape(3, 3, 3)
        cameras = (first_camera, second_camera)
        fundamental = _fundamental(cameras, rotation, truth[27:])
        if (sampson_distances(fundamental, first, second) < 1.5).sum() >= _FEWEST_INLIERS:
            motion = RelativePose(rotation, truth[27:])
            kinds: tuple[Kind, ...] = ("essential", "fundamental")
            for kind in kinds:
                yield Problem(kind, dataset, name, first, second, motion, cameras)
    else:
        raise ValueError(f"{name}: ground truth of {len(truth)} numbers, not 9, 21 or 30")


def _fundamental(
    cameras: tuple[FloatArray, ...], rotation: FloatArray, translation: FloatArray
) -> FloatArray:
    x, y, z = translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result: FloatArray = np.linalg.inv(cameras[1]).T @ cross @ rotation @ np.linalg.inv(cameras[0])
    return result


def _annotated(path: Path, kind: Kind) -> Iterator[Problem]:
    """Yield the problem of one labelled file.

    Where a model file stands beside it, label 1 marks points placed by hand to judge an
    estimate from the others. Otherwise labels name planes of the scene: an epipolar geometry
    is estimated from all points and judged on the labelled ones, if there are two planes.
    """
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise RansacFixError(f"{path}: not rows of numbers: {error}") from None
    if rows.shape[1] != 7:
        raise RansacFixError(f"{path}: rows of {rows.shape[1]} numbers, not x1 y1 1 x2 y2 1 label")
    name = path.stem.removesuffix("_pts")
    label = rows[:, 6]
    by_hand = path.with_name(f"{name}_model.txt").exists()
    if not by_hand and len(set(label[label > 0])) < 2:  # one plane: no unique epipolar geometry
        return
    given = rows[label == 0] if by_hand else rows
    judged = rows[label > 0]
    truth = CorrespondingPoints(judged[:, :2], judged[:, 3:5])
    first, second = (np.ascontiguousarray(given[:, c]) for c in (slice(0, 2), slice(3, 5)))
    yield Problem(kind, f"annotated {kind}", name, first, second, truth)


def _from_benchmark(folder: Path) -> Iterator[Problem]:
    """Yield the problems of the PoseLib benchmark's HDF5 files (github.com/vlarsson/posebench)."""
    for path in sorted((folder / "relative").glob("*.h5")):
        yield from _benchmark_file(path, ("essential", "fundamental"))
    for path in sorted((folder / "homography").glob("*.h5")):
        yield from _benchmark_file(path, ("homography",))
    for path in sorted((folder / "absolute").glob("*.h5")):
        yield from _benchmark_file(path, ("pnp",))


def _benchmark_file(path: Path, kinds: tuple[Kind, ...]) -> Iterator[Problem]:
    try:
        import h5py
    except ImportError:
        raise RansacFixError(
            f"{path}: reading it needs h5py: pip install 'ransac-fix[reproduce]'"
        ) from None
    limit = next(
        (limit for start, limit in _BENCHMARK_LIMITS.items() if path.stem.startswith(start)), 0.0
    )
    try:
        with h5py.File(path, "r") as file:
            names = list(file)
            if kinds == ("homography",):
                names = names[:_MOST_HOMOGRAPHIES]
            for name in names:
                group = file[name]
                rotation, translation = group["R"][:], group["t"][:].ravel()
                if kinds == ("pnp",):
                    camera, distortion = _benchmark_camera(group["camera"])
                    points = _undistorted(group["p2d"][:], camera, distortion)
                    scene = group["p3d"][:]
                    depth = float(np.median((scene @ rotation.T + translation)[:, 2]))
                    pose = AbsolutePose(rotation, translation, depth)
                    yield Problem("pnp", path.stem, name, points, scene, pose, (camera,), limit)
                    continue
                motion = RelativePose(rotation, translation)
                first_camera, first_distortion = _benchmark_camera(group["camera1"])
                second_camera, second_distortion = _benchmark_camera(group["camera2"])
                first = _undistorted(group["x1"][:], first_camera, first_distortion)
                second = _undistorted(group["x2"][:], second_camera, second_distortion)
                cameras = (first_camera, second_camera)
                for kind in kinds:
                    yield Problem(kind, path.stem, name, first, second, motion, cameras, limit)
    except (*_UNREADABLE, AttributeError, TypeError) as error:
        raise RansacFixError(f"{path}: not a file of the PoseLib benchmark: {error}") from None


def _benchmark_camera(group: "dict[str, object]") -> tuple[FloatArray, FloatArray]:
    """Return the calibration matrix, and the distortion k1, k2, p1, p2 of OpenCV's model."""
    model = group["model"].asstr()[0]  # type: ignore[attr-defined]
    parameters = group["params"][:]  # type: ignore[index]
    if model not in _PARAMETERS:
        known = ", ".join(_PARAMETERS)
        raise ValueError(f"camera model {model}, of which only {known} are read")
    named = dict(zip(_PARAMETERS[model].split(), map(float, parameters), strict=True))
    fx, fy = (named.get(axis, named.get("f", 0.0)) for axis in ("fx", "fy"))
    camera = np.array([[fx, 0.0, named["cx"]], [0.0, fy, named["cy"]], [0.0, 0.0, 1.0]])
    return camera, np.array([named.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")])


def _undistorted(points: FloatArray, camera: FloatArray, distortion: FloatArray) -> FloatArray:
    """Return where a camera without distortion would see the points, in pixels."""
    if not distortion.any():
        return np.ascontiguousarray(points, float)
    k1, k2, p1, p2 = distortion
    focal, centre = camera[[0, 1], [0, 1]], camera[:2, 2]
    seen = (points - centre) / focal
    ideal = seen.copy()
    for _ in range(_UNDISTORTIONS):  # a fixed point of: what is seen, less the distortion there
        x, y = ideal.T
        square = x * x + y * y
        radial = 1 + square * (k1 + square * k2)
        shift = np.column_stack(
            (
                2 * p1 * x * y + p2 * (square + 2 * x * x),
                p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            )
        )
        ideal = (seen - shift) / radial[:, None]
    return np.ascontiguousarray(ideal * focal + centre)


def load_stereo_pair() -> list[Problem]:
    """Return the problems of the stereo pair inside the scikit-image wheel.

    SIFT features of the left image are matched to their nearest neighbours in the right one,
    without a check back or a ratio test; the ground-truth disparity gives the scene. Nothing is
    downloaded.

    Returns
    -------
    list of Problem
        An essential matrix (judged by its pose), a fundamental matrix (judged on all points of
        known disparity), and the pose of the right camera from the left image's points in the
        scene.

    Notes
    -----
    The Motorcycle pair of the Middlebury 2014 stereo benchmark (Scharstein et al., GCPR 2014),
    with the calibration its documentation in scikit-image gives.
    """
    import cv2
    from skimage import data

    left, right, disparity = data.stereo_motorcycle()
    focal, cx, cy, shift, baseline = 994.978, 311.193, 254.877, 31.086, 193.001
    first_camera = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])
    second_camera = np.array([[focal, 0, cx + shift], [0, focal, cy], [0, 0, 1.0]])
    sift = cv2.SIFT.create()
    found = [
        sift.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)
        for image in (left, right)
    ]
    (points1, codes1), (points2, codes2) = found
    matches = cv2.BFMatcher(cv2.NORM_L2).match(codes1, codes2)
    first = np.array([points1[m.queryIdx].pt for m in matches])
    second = np.array([points2[m.trainIdx].pt for m in matches])
    motion = RelativePose(np.eye(3), np.array([-baseline, 0.0, 0.0]))
    cameras = (first_camera, second_camera)
    dataset, name = "motorcycle", "left__right"
    column, row = np.rint(first).astype(int).T
    offset = disparity[row, column]
    known = np.isfinite(offset)
    depth = focal * baseline / (offset + shift)
    moved = np.column_stack((offset, np.zeros(len(offset))))
    points = CorrespondingPoints(first[known], (first - moved)[known])
    rays = np.column_stack(((first - (cx, cy)) / focal, np.ones(len(first))))
    scene = (rays * depth[:, None])[known]
    pose = AbsolutePose(np.eye(3), motion.translation, float(np.median(depth[known])))
    return [
        Problem("essential", dataset, name, first, second, motion, cameras),
        Problem("fundamental", dataset, name, first, second, points, cameras),
        Problem("pnp", dataset, name, second[known], scene, pose, (second_camera,)),
    ]

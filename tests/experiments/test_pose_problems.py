from dataclasses import replace

import cv2
import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.pose.loaders import load_problems, load_stereo_pair
from ransac_fix.experiments.pose.problems import (
    AbsolutePose,
    CorrespondingPoints,
    Estimate,
    Problem,
    RelativePose,
    angle_between,
    rotation_angle,
    sampson_distances,
)
from ransac_fix.experiments.pose.stopping import first_stop

CAMERA = np.array([[800.0, 0, 320], [0, 790.0, 240], [0, 0, 1]])
OTHER = np.array([[700.0, 0, 300], [0, 705.0, 250], [0, 0, 1]])
ROTATION = Rotation.from_euler("xyz", [5, -8, 3], degrees=True).as_matrix()
TRANSLATION = np.array([1.0, 0.2, -0.3])


def project(camera, points):
    image = points @ camera.T
    return image[:, :2] / image[:, 2:]


def scene(n, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack((rng.uniform(-2, 2, (n, 2)), rng.uniform(5, 9, n)))


def cross(t):
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def two_views(kind, n=40):
    points = scene(n)
    first, second = project(CAMERA, points), project(OTHER, points @ ROTATION.T + TRANSLATION)
    truth = RelativePose(ROTATION, TRANSLATION)
    return Problem(kind, "made", "pair", first, second, truth, (CAMERA, OTHER))


FUNDAMENTAL = np.linalg.inv(OTHER).T @ cross(TRANSLATION) @ ROTATION @ np.linalg.inv(CAMERA)
TRUE_POSE = np.column_stack((ROTATION, TRANSLATION))


def all_inliers(model, n=40):
    return Estimate(model, np.ones(n, bool))


def test_the_true_motion_has_no_error_in_any_form():
    assert RelativePose(ROTATION, TRANSLATION).error(
        two_views("essential"), all_inliers(TRUE_POSE * [1, 1, 1, 7])
    ) == pytest.approx(0, abs=1e-5)
    problem = two_views("fundamental")
    assert problem.truth.error(problem, all_inliers(3 * FUNDAMENTAL)) < 1e-3
    normal = np.array([0.1, -0.2, 1.0])
    plane = OTHER @ (ROTATION + np.outer(TRANSLATION, normal) / 6) @ np.linalg.inv(CAMERA)
    problem = two_views("homography")
    assert problem.truth.error(problem, all_inliers(plane)) < 1e-3


def test_pose_error_is_the_larger_angle():
    problem = two_views("essential")
    turned = Rotation.from_euler("z", 4, degrees=True).as_matrix() @ ROTATION
    pose = np.column_stack((turned, TRANSLATION))
    assert problem.truth.error(problem, all_inliers(pose)) == pytest.approx(4)
    shifted = np.column_stack((turned, -TRANSLATION))
    assert problem.truth.error(problem, all_inliers(shifted)) == pytest.approx(180)
    assert angle_between(np.zeros(3), TRANSLATION) == 180


@given(st.floats(0, 175), st.integers(0, 2**31))
@settings(derandomize=True)
def test_rotation_angle_keeps_its_digits(degrees, seed):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    assert rotation_angle(turn @ ROTATION, ROTATION) == pytest.approx(degrees, abs=2e-6)


def test_no_estimate_is_infinitely_far():
    for kind in ("essential", "fundamental", "homography"):
        problem = two_views(kind)
        assert problem.truth.error(problem, all_inliers(None)) == np.inf
    few = Estimate(FUNDAMENTAL, np.arange(40) < 4)
    problem = two_views("fundamental")
    assert problem.truth.error(problem, few) == np.inf
    points = CorrespondingPoints(problem.first, problem.second)
    assert points.error(problem, all_inliers(np.full((3, 3), np.nan))) == np.inf


def test_absolute_pose_error_is_degrees_or_percent_of_depth():
    truth = AbsolutePose(ROTATION, TRANSLATION, depth=5.0)
    problem = two_views("essential")
    moved = TRANSLATION - ROTATION @ np.array([0.5, 0, 0])  # the centre moves by 0.5
    error = truth.error(problem, all_inliers(np.column_stack((ROTATION, moved))))
    assert error == pytest.approx(10)
    assert truth.error(problem, all_inliers(TRUE_POSE)) == pytest.approx(0, abs=1e-5)


def test_point_errors_are_pixels():
    problem = two_views("fundamental")
    assert sampson_distances(FUNDAMENTAL, problem.first, problem.second).max() < 1e-9
    points = CorrespondingPoints(problem.first, problem.second)
    assert points.error(problem, all_inliers(FUNDAMENTAL)) < 1e-9
    shift = np.array([[1, 0, 3.0], [0, 1, 4.0], [0, 0, 1]])
    homography = two_views("homography")
    points = CorrespondingPoints(problem.first, problem.first)
    assert points.error(homography, all_inliers(shift)) == pytest.approx(5)


def test_subsamples_depend_on_names_and_numbers_alone():
    problem = two_views("essential")
    one, again = problem.subsample(20, 0, 3), problem.subsample(20, 0, 3)
    np.testing.assert_array_equal(one.first, again.first)
    np.testing.assert_array_equal(one.second, again.second)
    assert len(np.unique(one.first, axis=0)) == 20
    for other in (problem.subsample(20, 1, 3), problem.subsample(20, 0, 4)):
        assert not np.array_equal(one.first, other.first)
    renamed = replace(problem, name="another").subsample(20, 0, 3)
    assert not np.array_equal(one.first, renamed.first)


@given(st.data())
@settings(max_examples=300, derandomize=True)
def test_first_stop_is_the_first_of_all_trials(data):
    cap = data.draw(st.integers(1, 120))
    growth = data.draw(st.lists(st.integers(1, 120), max_size=8).map(sorted))
    needed = data.draw(
        st.lists(st.integers(0, 150) | st.just(float("inf")), min_size=9, max_size=9)
    )
    needed.sort(reverse=True)
    start = data.draw(st.integers(1, cap))

    def inliers_after(trials):
        assert 1 <= trials <= cap
        return sum(at <= trials for at in growth)

    met = [m for m in range(start, cap + 1) if m >= needed[inliers_after(m)]]
    stop = first_stop(inliers_after, lambda n: needed[n], cap, start=start)
    assert stop.capped == (not met)
    assert stop.trials == (met[0] if met else cap)


def test_first_stop_needs_few_runs():
    asked = []

    def inliers_after(trials):
        asked.append(trials)
        return 9 if trials >= 700 else 5

    stop = first_stop(inliers_after, {5: 90_000, 9: 1000}.__getitem__, 10**6)
    assert stop.trials == 1000
    assert len(asked) < 12
    assert sum(asked) < 15_000


def save_arrays(folder):
    points = scene(60)
    first, second = project(CAMERA, points), project(OTHER, points @ ROTATION.T + TRANSLATION)
    extra = np.zeros((60, 2))
    motion = np.concatenate([CAMERA.ravel(), OTHER.ravel(), ROTATION.ravel(), TRANSLATION])
    pose = np.concatenate([OTHER.ravel(), ROTATION.ravel(), TRANSLATION])
    shift = np.array([[1, 0, 3.0], [0, 1, 4.0], [0, 0, 1]])
    sift = folder / "sift"
    sift.mkdir(parents=True)
    np.savez(
        sift / "street.npz",
        a__b=np.column_stack((first, second, extra)),
        a__b__gt=motion,
        far=np.column_stack((first, second[::-1], extra)),  # fewer than twelve inliers
        far__gt=motion,
    )
    rows = np.column_stack((second, points, extra))
    np.savez(sift / "pnp_street.npz", q=rows, q__gt=pose)
    np.savez(
        sift / "wall.npz",
        a=np.column_stack((first, first + np.array([3, 4]), extra)),
        a__gt=shift.ravel(),
    )
    np.savez(sift / "reg3d_street.npz", a=np.zeros((5, 8)), a__gt=np.zeros(13))
    ones = np.ones(60)
    label = np.where(np.arange(60) < 8, 1, 0)
    annotated = np.column_stack((first, ones, second, ones, label))
    for kind in ("homography", "fundamental"):
        (folder / "annotated" / kind).mkdir(parents=True)
        np.savetxt(folder / "annotated" / kind / "yard_pts.txt", annotated)
        np.savetxt(folder / "annotated" / kind / "yard_model.txt", np.zeros((3, 3)))
    planes = np.column_stack((first, ones, second, ones, np.arange(60) % 3))
    np.savetxt(folder / "annotated" / "fundamental" / "planes_pts.txt", planes)
    planes[:, 6] = planes[:, 6] > 0
    np.savetxt(folder / "annotated" / "fundamental" / "one-plane_pts.txt", planes)


def test_the_projects_layout_is_read(tmp_path):
    save_arrays(tmp_path)
    problems = load_problems(tmp_path)
    assert [(p.kind, p.dataset, p.name, len(p.first)) for p in problems] == [
        ("pnp", "pnp_street", "q", 60),
        ("essential", "street", "a__b", 60),
        ("fundamental", "street", "a__b", 60),
        ("homography", "wall", "a", 60),
        ("homography", "annotated homography", "yard", 52),
        ("fundamental", "annotated fundamental", "planes", 60),
        ("fundamental", "annotated fundamental", "yard", 52),
    ]
    by_kind = {(p.kind, p.dataset): p for p in problems}
    pnp = by_kind["pnp", "pnp_street"]
    assert pnp.truth.error(pnp, all_inliers(TRUE_POSE, 60)) < 1e-5
    pair = by_kind["fundamental", "street"]
    assert pair.truth.error(pair, all_inliers(FUNDAMENTAL, 60)) < 1e-3
    judged = by_kind["fundamental", "annotated fundamental"]
    assert len(judged.truth.first) == 8  # by hand: only those
    assert by_kind["homography", "annotated homography"].limit == 3.0


def camera_group(group, name, camera, model="PINHOLE"):
    made = group.create_group(name)
    made.create_dataset("model", data=[model], dtype=h5py.string_dtype())
    made.create_dataset("width", data=[640])
    made.create_dataset("height", data=[480])
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    focal = [fx] if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL") else [fx, fy]
    made.create_dataset("params", data=[*focal, cx, cy, *DISTORTION.get(model, [])])


DISTORTION = {
    "SIMPLE_RADIAL": [-0.1],
    "RADIAL": [-0.1, 0.02],
    "OPENCV": [-0.1, 0.02, 0.003, -0.002],
}


def distorted(points, camera, model):
    """Where COLMAP's camera model, which is OpenCV's here, sees the points."""
    if model not in DISTORTION:
        return points
    if model != "OPENCV":  # one focal length
        camera = camera.copy()
        camera[1, 1] = camera[0, 0]
    coefficients = np.zeros(4)
    coefficients[: len(DISTORTION[model])] = DISTORTION[model]
    rays = np.column_stack((points, np.ones(len(points)))) @ np.linalg.inv(camera).T
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera, coefficients)[0][:, 0]


def save_benchmark(folder, model="PINHOLE"):
    points = scene(30)
    first, second = project(CAMERA, points), project(OTHER, points @ ROTATION.T + TRANSLATION)
    first, second = distorted(first, CAMERA, model), distorted(second, OTHER, model)
    for name in ("relative/scannet1500_sift", "homography/barath_Alamo", "absolute/eth3d_130_x"):
        path = folder / f"{name}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(path, "w") as file:
            group = file.create_group("pair_0")
            group["R"], group["t"] = ROTATION, TRANSLATION.reshape(3, 1)
            if name.startswith("absolute"):
                group["p2d"], group["p3d"] = second, points
                camera_group(group, "camera", OTHER, model)
            else:
                group["x1"], group["x2"] = first, second
                camera_group(group, "camera1", CAMERA, model)
                camera_group(group, "camera2", OTHER, model)


@pytest.mark.parametrize("model", ["PINHOLE", "SIMPLE_PINHOLE", *DISTORTION])
def test_the_benchmarks_layout_is_read(tmp_path, model):
    save_benchmark(tmp_path, model)
    problems = load_problems(tmp_path)
    assert [(p.kind, p.dataset, p.limit) for p in problems] == [
        ("essential", "scannet1500_sift", 1.5),
        ("fundamental", "scannet1500_sift", 1.5),
        ("homography", "barath_Alamo", 1.0),
        ("pnp", "eth3d_130_x", 12.0),
    ]
    for problem in problems:
        assert problem.first.shape == (30, 2)
        assert problem.cameras[0][0, 2] in (CAMERA[0, 2], OTHER[0, 2])
    assert problems[3].truth.error(problems[3], all_inliers(TRUE_POSE, 30)) < 1e-5
    assert problems[0].truth.error(problems[0], all_inliers(TRUE_POSE, 30)) < 1e-5
    # as a camera without distortion sees them
    points = scene(30)
    seen = points @ ROTATION.T + TRANSLATION
    np.testing.assert_allclose(problems[0].first, project(CAMERA, points), atol=1e-6)
    np.testing.assert_allclose(problems[0].second, project(OTHER, seen), atol=1e-6)
    np.testing.assert_allclose(problems[3].first, project(OTHER, seen), atol=1e-6)


def break_array(folder):
    save_arrays(folder)
    (folder / "sift" / "street.npz").write_bytes(b"nonsense")


def break_truth(folder):
    save_arrays(folder)
    np.savez(folder / "sift" / "street.npz", a=np.zeros((20, 6)), a__gt=np.zeros(7))


def break_zip(folder):
    save_arrays(folder)
    file = folder / "sift" / "street.npz"
    file.write_bytes(file.read_bytes()[:200])


def break_shape(folder):
    save_arrays(folder)
    np.savez(folder / "sift" / "street.npz", a=np.zeros(20), a__gt=np.zeros(9))


def break_numbers(folder):
    save_arrays(folder)
    np.savez(folder / "sift" / "street.npz", a=np.zeros((20, 6)), a__gt=np.array(["x"] * 9))


def break_rows(folder):
    save_arrays(folder)
    (folder / "annotated" / "fundamental" / "yard_pts.txt").write_text("1 2 3\n")


def break_words(folder):
    save_arrays(folder)
    (folder / "annotated" / "homography" / "yard_pts.txt").write_text("one two\n")


def break_group(folder):
    save_benchmark(folder)
    with h5py.File(folder / "relative" / "scannet1500_sift.h5", "a") as file:
        del file["pair_0"]["x2"]


def break_model(folder):
    save_benchmark(folder)
    with h5py.File(folder / "relative" / "scannet1500_sift.h5", "a") as file:
        del file["pair_0"]["camera1"]["model"]
        file["pair_0"]["camera1"]["model"] = [1.0]


def break_camera(folder):
    save_benchmark(folder, "OPENCV_FISHEYE")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (break_array, "street.npz: not correspondences with ground truth"),
        (break_truth, "street.npz: .* ground truth of 7 numbers"),
        (break_zip, "street.npz: not correspondences with ground truth"),
        (break_shape, "street.npz: not correspondences with ground truth"),
        (break_numbers, "street.npz: not correspondences with ground truth"),
        (break_model, "not a file of the PoseLib benchmark"),
        (break_rows, "rows of 3 numbers"),
        (break_words, "not rows of numbers"),
        (break_group, "not a file of the PoseLib benchmark"),
        (break_camera, "camera model OPENCV_FISHEYE"),
        (lambda folder: None, "neither sift"),
        (lambda folder: folder.rmdir(), "no such folder"),
    ],
)
def test_a_damaged_folder_is_one_clear_error(tmp_path, damage, message):
    damage(tmp_path)
    with pytest.raises(RansacFixError, match=message):
        load_problems(tmp_path)


def test_the_stereo_pair_is_consistent_with_its_own_ground_truth():
    essential, fundamental, pnp = load_stereo_pair()
    assert [p.kind for p in (essential, fundamental, pnp)] == ["essential", "fundamental", "pnp"]
    motion = essential.truth
    f = np.linalg.inv(essential.cameras[1]).T @ cross(motion.translation) @ motion.rotation
    f = f @ np.linalg.inv(essential.cameras[0])
    inliers = sampson_distances(f, essential.first, essential.second) < 1.5
    assert 0.3 < inliers.mean() < 0.7
    # rectified: a true correspondence lies on the same row
    assert np.abs(essential.first - essential.second)[inliers, 1].max() < 3.1
    assert fundamental.truth.error(fundamental, Estimate(f, inliers)) < 1e-6
    true_pose = np.column_stack((motion.rotation, motion.translation))
    seen = pnp.second @ motion.rotation.T + motion.translation
    off = np.linalg.norm(project(pnp.cameras[0], seen) - pnp.first, axis=1)
    assert 0.3 < (off < 3).mean() < 0.7
    assert pnp.truth.error(pnp, Estimate(true_pose, off < 3)) < 1e-9

"""Outcomes of the wrapped libraries that the tests cannot install: bare and exact.

    python benchmarks/wrapper_proof.py colmap     # in an environment with pycolmap 3.11.1
    OMP_NUM_THREADS=1 python benchmarks/wrapper_proof.py open3d    # ... with open3d 0.19 or 0.20

Two groups of measurements are planted, and the larger one is to be found. With the smaller in
hand after N trials, its chance follows from N: Wald's test decides between the number of trials
of the library's rule and the exact one (error 1e-4), for the library as it is and wrapped, with
a slack of 0. Prints Markdown; the exit code is 1 where a wrapped function does not come out
exact.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ransac_fix import approximate_required_trials, patched, required_trials
from ransac_fix.patching import missing

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "systems"))
from planted_views import (
    Planted,
    chance_of_larger,
    likelihood_ratio,
    plant,
)

CONFIDENCE = 0.5
# name, kind of problem, n, sizes, k, sampling, call -> mask
Case = tuple[str, str, int, tuple[int, int], int, Any, Callable[[Planted, int], Any]]


def colmap_cases() -> list[Case]:
    import pycolmap

    camera = pycolmap.Camera(
        model="PINHOLE", width=640, height=480, params=[800.0, 800.0, 320.0, 240.0]
    )
    options = {
        "max_error": 0.02,
        "min_num_trials": 0,
        "max_num_trials": 1_000_000,
        "dyn_num_trials_multiplier": 1.0,
        "min_inlier_ratio": 1e-6,
        "confidence": CONFIDENCE,
    }
    pose = {"ransac": options}

    def of(result: Any) -> Any:
        return None if result is None else result["inlier_mask"]

    return [
        (
            "estimate_homography_matrix",
            *("affine", 14, (5, 6), 4, "distinct"),
            lambda p, _: of(pycolmap.estimate_homography_matrix(p.x, p.y, options)),
        ),
        (
            "estimate_fundamental_matrix",
            *("two views", 20, (9, 10), 7, "distinct"),
            lambda p, _: of(pycolmap.estimate_fundamental_matrix(p.x, p.y, options)),
        ),
        (
            "estimate_essential_matrix",
            *("two views", 16, (7, 8), 5, "distinct"),
            lambda p, _: of(pycolmap.estimate_essential_matrix(p.x, p.y, camera, camera, options)),
        ),
        (
            "estimate_absolute_pose",
            *("pose", 14, (5, 6), 3, "distinct"),
            lambda p, _: of(pycolmap.estimate_absolute_pose(p.y, p.x, camera, pose)),
        ),
        (
            "estimate_and_refine_absolute_pose",
            *("pose", 14, (5, 6), 3, "distinct"),
            lambda p, _: of(pycolmap.estimate_and_refine_absolute_pose(p.y, p.x, camera, pose)),
        ),
    ]


def open3d_cases() -> list[Case]:
    import open3d

    registration = open3d.pipelines.registration
    criteria = registration.RANSACConvergenceCriteria(100_000, CONFIDENCE)

    def cloud(points: Any) -> Any:
        return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

    def register(p: Planted, seed: int) -> Any:
        open3d.utility.random.seed(seed)
        pairs = open3d.utility.Vector2iVector(np.arange(len(p.x)).repeat(2).reshape(-1, 2))
        found = registration.registration_ransac_based_on_correspondence(
            cloud(p.x), cloud(p.y), pairs, 1e-4, criteria=criteria
        )
        mask = np.zeros(len(p.x), bool)
        mask[np.asarray(found.correspondence_set)[:, 0]] = True
        return mask

    def segment(p: Planted, seed: int) -> Any:
        open3d.utility.random.seed(seed)
        # The planted planes: z as a function of x and y, one in each group.
        points = p.x.copy()
        rng = np.random.default_rng(seed)
        for label in (0, 1):
            slope = rng.uniform(-0.5, 0.5, 2)
            group = p.labels == label
            points[group, 2] = points[group, :2] @ slope + rng.uniform(-0.5, 0.5)
        mask = np.zeros(len(points), bool)
        mask[cloud(points).segment_plane(1e-6, 3, 100_000, CONFIDENCE)[1]] = True
        return mask

    return [
        (
            "registration_ransac_based_on_correspondence",
            *("rigid", 12, (4, 5), 3, "replacement"),
            register,
        ),
        ("PointCloud.segment_plane", "rigid", 14, (5, 6), 3, "distinct", segment),
    ]


def main(system: str) -> int:
    """Run all cases of a system; return the exit code."""
    cases = {"colmap": colmap_cases, "open3d": open3d_cases}[system]()
    missing.set_slack(0)
    print("| function | N_a | N_e | chance | bare | wrapped |")
    print("| --- | --- | --- | --- | --- | --- |")
    failed = False
    for name, kind, n_samples, sizes, k, sampling, call in cases:
        setting = sizes[0], n_samples, k, CONFIDENCE
        trials = approximate_required_trials(*setting), required_trials(*setting, sampling=sampling)
        if sampling == "distinct":
            hits = [math.comb(size, k) / math.comb(n_samples, k) for size in sizes]
        else:
            hits = [math.perm(size, k) / n_samples**k for size in sizes]
        unlikely, likely = (chance_of_larger(number, *hits) for number in trials)

        def run(seed: int, args: Any = (kind, n_samples, sizes), call: Any = call) -> bool:
            planted = plant(*args, seed)
            return planted.found(call(planted, seed)) == 1

        bare = likelihood_ratio(run, likely, unlikely)
        with patched(system, threads=True):
            wrapped = likelihood_ratio(run, likely, unlikely)
        failed |= not wrapped[0]
        words = {True: "exact", False: "approximate", None: "undecided"}
        cells = [f"{words[is_exact]} ({hit} of {runs})" for is_exact, hit, runs in (bare, wrapped)]
        chances = f"{unlikely:.3f} or {likely:.3f}"
        print(f"| {name} | {trials[0]} | {trials[1]} | {chances} | {' | '.join(cells)} |")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

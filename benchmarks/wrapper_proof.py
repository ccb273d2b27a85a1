"""Outcomes of wrapped libraries that cannot be seeded: bare and exact.

    python benchmarks/wrapper_proof.py magsac     # in an environment with pymagsac 0.2.3
    python benchmarks/wrapper_proof.py gc-ransac    # ... with pygcransac 0.1.1 and NumPy 1
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
    CAMERA,
    Planted,
    chance_of_larger,
    likelihood_ratio,
    plant,
)

CONFIDENCE = 0.5
# name, kind of problem, n, sizes, k, sampling, call -> mask
Case = tuple[str, str, int, tuple[int, int], int, Any, Callable[[Planted, int], Any]]


def _rows(p: Planted) -> np.ndarray:
    return np.hstack([p.x, p.y])


def magsac_cases() -> list[Case]:
    import pymagsac

    settings = {"sampler": 0, "sigma_th": 0.02, "conf": CONFIDENCE, "min_iters": 0}
    settings["max_iters"] = 100_000
    size = 1100.0, 1100.0, 1100.0, 1100.0

    def call(name: str, *between: Any) -> Callable[[Planted, int], Any]:
        # Looked up in every call: patched or not.
        return lambda p, _: getattr(pymagsac, name)(
            _rows(p), *between, np.ones(len(p.x)), **settings
        )[1]

    return [
        ("findHomography", *("affine", 14, (5, 6), 4, "distinct"), call("findHomography", *size)),
        (
            "findFundamentalMatrix",
            *("two views", 21, (10, 11), 7, "distinct"),
            call("findFundamentalMatrix", *size),
        ),
        (
            "findEssentialMatrix",
            # Of fewer measurements refinement finds the planted ones from other samples too.
            *("two views", 40, (12, 13), 5, "distinct"),
            call("findEssentialMatrix", CAMERA, CAMERA, *size),
        ),
        (
            "findRigidTransformation",
            *("rigid", 14, (5, 6), 3, "distinct"),
            call("findRigidTransformation"),
        ),
    ]


def gc_ransac_cases() -> list[Case]:
    import pygcransac

    settings = {"sampler": 0, "conf": CONFIDENCE, "min_iters": 0, "max_iters": 100_000}
    settings |= {"use_sprt": False, "lo_number": 0, "spatial_coherence_weight": 0.0}
    size = 1100, 1100, 1100, 1100
    whole = {"use_space_partitioning": False}

    def call(
        name: str, threshold: float, *between: Any, **more: Any
    ) -> Callable[[Planted, int], Any]:
        chosen = {"threshold": threshold, **settings, **more}
        return lambda p, _: getattr(pygcransac, name)(
            _rows(p), *between, np.ones(len(p.x)), **chosen
        )[1]

    return [
        (
            "findHomography",
            *("affine", 14, (5, 6), 4, "distinct"),
            call("findHomography", 0.02, *size, **whole),
        ),
        (
            "findFundamentalMatrix",
            *("two views", 20, (9, 10), 7, "distinct"),
            call("findFundamentalMatrix", 0.01, *size),
        ),
        (
            "findEssentialMatrix",
            *("two views", 16, (7, 8), 5, "distinct"),
            call("findEssentialMatrix", 0.01, CAMERA, CAMERA, *size),
        ),
        (
            "findRigidTransform",
            *("rigid", 14, (5, 6), 3, "distinct"),
            call("findRigidTransform", 1e-4, **whole),
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
    kinds = {"magsac": magsac_cases, "gc-ransac": gc_ransac_cases, "open3d": open3d_cases}
    cases = kinds[system]()
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
        least = k, n_samples, k, CONFIDENCE
        most = approximate_required_trials(*least), required_trials(*least, sampling=sampling)
        unlikely, likely = (
            chance_of_larger(number, *hits, last) for number, last in zip(trials, most, strict=True)
        )

        def run(seed: int, args: Any = (kind, n_samples, sizes), call: Any = call) -> bool:
            planted = plant(*args, seed)
            mask = call(planted, seed)
            return mask is not None and bool(np.all(np.asarray(mask)[planted.labels == 1]))

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

"""What the wrappers of compiled libraries cost, on real pairs and on synthetic ones.

    python benchmarks/wrapper_overhead.py DATA [--repeat 9] [--slack 0.1]

DATA is a folder of NPZ files: each key holds rows ``x1 y1 x2 y2 ratio ...`` of one image pair,
or ``x y X Y Z ratio ...`` of one image and a cloud of points in files named ``pnp_*``.

Bare and wrapped calls of one problem alternate; the least processor time of the repeated calls
of each kind is compared, so that other work on the machine counts little. A problem is *good
enough* when the library's own rule left no trial missing by more than the slack. Elsewhere the
cost is compared with N_e / N_a at the inliers found.

Prints Markdown.
"""

import argparse
import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import ransac_fix
from ransac_fix import criterion
from ransac_fix.patching import missing, registry
from ransac_fix.patching.watching import Watched, watching

PINHOLE = {"model": "SIMPLE_PINHOLE", "width": 2000, "height": 1500}
SIZES = (20, 50, 100, 500, 1000, 5000)
RATIOS = (0.25, 0.4, 0.6, 0.8)
# Seconds for one problem.
_LONGEST = 3.0


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem: what kind it is, where from, and its two sides."""

    kind: str
    source: str
    x: np.ndarray
    y: np.ndarray
    camera: np.ndarray | None = None


Call = Callable[[Problem], Any]
Calls = dict[tuple[str, str], Call]


def opencv_calls() -> Calls:
    """Return OpenCV's functions: (kind of problem, name) -> call."""
    import cv2

    def homography(method: int) -> Call:
        return lambda p: cv2.findHomography(p.x, p.y, method, 3.0, None, 10_000, 0.99)[1]

    def fundamental(method: int) -> Call:
        return lambda p: cv2.findFundamentalMat(p.x, p.y, method, 1.5, 0.99, 10_000)[1]

    def pose(flags: int) -> Call:
        return lambda p: cv2.solvePnPRansac(
            p.x,
            p.y,
            p.camera,
            None,
            iterationsCount=10_000,
            reprojectionError=3.0,
            confidence=0.99,
            flags=flags,
        )[3]

    return {
        ("plane", "cv2.findHomography RANSAC"): homography(cv2.RANSAC),
        ("plane", "cv2.findHomography USAC_DEFAULT"): homography(cv2.USAC_DEFAULT),
        ("views", "cv2.findFundamentalMat FM_RANSAC"): fundamental(cv2.FM_RANSAC),
        ("views", "cv2.findFundamentalMat USAC_DEFAULT"): fundamental(cv2.USAC_DEFAULT),
        ("pose", "cv2.solvePnPRansac EPNP"): pose(cv2.SOLVEPNP_EPNP),
    }


def poselib_calls() -> Calls:
    """Return PoseLib's estimators, once with a multiplier of 1 and no floor."""
    import poselib

    options = {
        "max_iterations": 10_000,
        "success_prob": 0.99,
        "max_reproj_error": 3.0,
        "max_epipolar_error": 1.5,
    }
    neutral = {**options, "min_iterations": 0, "dyn_num_trials_mult": 1.0}

    def camera(p: Problem) -> dict[str, Any]:
        assert p.camera is not None
        focal, centre = p.camera[0, 0], p.camera[:2, 2]
        return {**PINHOLE, "params": [focal, *centre]}

    found = {}
    for label, settings in (("", options), (", multiplier 1", neutral)):
        found["plane", f"poselib.estimate_homography{label}"] = lambda p, s=settings: np.array(
            poselib.estimate_homography(p.x, p.y, s, {})[1]["inliers"]
        )
        found["views", f"poselib.estimate_fundamental{label}"] = lambda p, s=settings: np.array(
            poselib.estimate_fundamental(p.x, p.y, s, {})[1]["inliers"]
        )
        found["pose", f"poselib.estimate_absolute_pose{label}"] = lambda p, s=settings: np.array(
            poselib.estimate_absolute_pose(p.y, p.x, camera(p), s, {})[1]["inliers"]
        )
    return found


def pydegensac_calls() -> Calls:
    """Return pydegensac's functions."""
    import pydegensac

    return {
        ("plane", "pydegensac.findHomography"): lambda p: pydegensac.findHomography(
            p.x, p.y, 3.0, 0.99, 10_000, seed=1
        )[1],
        ("views", "pydegensac.findFundamentalMatrix"): lambda p: pydegensac.findFundamentalMatrix(
            p.x, p.y, 1.5, 0.99, 10_000, seed=1
        )[1],
    }


def kornia_rs_calls() -> Calls:
    """Return the functions of kornia-rs; its thresholds are of squared distances."""
    import kornia_rs

    def call(name: str, threshold: float) -> Call:
        function = kornia_rs.ransac

        def run(p: Problem) -> Any:
            data = np.hstack([p.x, p.y])
            found = getattr(function, name)(data, threshold, 10_000, 0.99, 1)
            return np.array(found.inliers)

        return run

    return {
        ("plane", "kornia_rs.ransac.homography"): call("homography", 9.0),
        ("views", "kornia_rs.ransac.fundamental"): call("fundamental", 2.25),
    }


LIBRARIES = {
    "opencv": opencv_calls,
    "poselib": poselib_calls,
    "pydegensac": pydegensac_calls,
    "kornia-rs": kornia_rs_calls,
}


def real_problems(folder: Path, per_file: int) -> Iterator[Problem]:
    """Yield up to so many problems of each file, evenly over its keys."""
    for path in sorted(folder.rglob("*.npz")):
        if path.name.startswith("reg3d"):
            continue
        with np.load(path) as pairs:
            keys = sorted(key for key in pairs.files if not key.endswith("__gt"))
            for key in keys[:: max(1, len(keys) // per_file)][:per_file]:
                rows, truth = np.asarray(pairs[key], float), np.ravel(pairs[f"{key}__gt"])
                if path.name.startswith("pnp_"):
                    good = rows[:, 5] < 0.85
                    x, y = rows[good, 2:5], rows[good, :2]
                    if len(x) > 8:
                        yield Problem("pose", path.stem, x, y, truth[:9].reshape(3, 3))
                    continue
                good = rows[:, 4] < 0.85
                x, y = np.ascontiguousarray(rows[good, :2]), np.ascontiguousarray(rows[good, 2:4])
                if len(x) > 15:
                    kind = "plane" if truth.size == 9 else "views"
                    yield Problem(kind, path.stem, x, y)


def synthetic_problems(seed: int = 0) -> Iterator[Problem]:
    """Yield planes and pairs of views with noise, over sizes and ratios; the last have no model."""
    rng = np.random.default_rng(seed)
    camera = np.array([[800.0, 0, 500], [0, 800, 500], [0, 0, 1]])
    for n_samples in SIZES:
        for ratio in (*RATIOS, 0.0):
            n_inliers = round(ratio * n_samples)
            source = "no model" if ratio == 0 else f"synthetic {n_samples}"
            x = rng.uniform(0, 1000, (n_samples, 2))
            y = rng.uniform(0, 1000, (n_samples, 2))
            y[:n_inliers] = x[:n_inliers] @ [[1.1, 0.1], [-0.1, 0.9]] + [20, -30]
            y[:n_inliers] += rng.normal(0, 0.7, (n_inliers, 2))
            yield Problem("plane", source, x, y)
            points = rng.uniform((-2, -2, 4), (2, 2, 8), (n_samples, 3))
            a = points @ camera.T
            turned = points @ np.array([[0.995, 0, 0.0998], [0, 1, 0], [-0.0998, 0, 0.995]])
            b = (turned + np.array([0.8, 0.1, 0.1])) @ camera.T
            x, y = a[:, :2] / a[:, 2:], b[:, :2] / b[:, 2:]
            x += rng.normal(0, 0.4, x.shape)
            y[n_inliers:] = rng.uniform(0, 1000, (n_samples - n_inliers, 2))
            yield Problem("views", source, x, y)
            yield Problem("pose", source, points, y_of_pose(x, n_inliers, rng), camera)


def y_of_pose(image: np.ndarray, n_inliers: int, rng: np.random.Generator) -> np.ndarray:
    y = image.copy()
    y[n_inliers:] = rng.uniform(0, 1000, (len(y) - n_inliers, 2))
    return y


@dataclass(frozen=True, slots=True)
class Cost:
    """What one problem cost: seconds, and N_e / N_a where trials were missing."""

    bare: float
    wrapped: float
    expected: float | None

    @property
    def ratio(self) -> float:
        return self.wrapped / self.bare


def measure(call: Call, system: str, problem: Problem, repeat: int) -> Cost:
    """Return what a call costs, bare and wrapped."""
    ransac_fix.patch(system)
    expected = excess(call, problem)
    places = registry.places(system)
    least = {"original": math.inf, "replaced": math.inf}
    spent = 0.0
    for turn in range(repeat):
        for kind in sorted(least, reverse=bool(turn % 2)):
            for place in places:
                setattr(place.holder, place.name, getattr(place, kind))
            # A program rarely solves the same problem twice.
            criterion._SETTINGS.clear()
            start = time.process_time()
            call(problem)
            taken = time.process_time() - start
            least[kind] = min(least[kind], taken)
            spent += taken
        if spent > _LONGEST:
            break
    for place in places:
        setattr(place.holder, place.name, place.replaced)
    ransac_fix.unpatch(system)
    return Cost(least["original"], least["replaced"], expected)


def excess(call: Call, problem: Problem) -> float | None:
    """Return N_e / N_a at the inliers found, as far as limits allow; None if nothing is missing."""
    watched = Watched(exact=False)  # the library as it is, and what it says of the run
    with watching(watched):
        call(problem)
    if watched.facts is None:
        return None
    counts, (trials, limit), how = watched.facts[:4], watched.facts[4:6], watched.facts[6:]
    lacking = missing.missing_trials(*counts, trials, limit, missing.slack(), *how)
    return (trials + lacking) / trials if lacking else None


def percent(values: list[float]) -> str:
    return f"{100 * (statistics.median(values) - 1):+.1f} %" if values else ""


def row(label: str, costs: list[Cost]) -> str:
    enough = [cost for cost in costs if cost.expected is None]
    short = [(cost.ratio, cost.expected) for cost in costs if cost.expected is not None]
    times = [cost.bare for cost in enough]
    cells = [
        label,
        str(len(enough)),
        f"{1e3 * statistics.median(times):.3g}" if times else "",
        f"{1e6 * statistics.median([c.wrapped - c.bare for c in enough]):.1f}" if enough else "",
        percent([cost.ratio for cost in enough]),
        str(len(short)),
        f"{statistics.median([expected for _, expected in short]):.2f}" if short else "",
        f"{statistics.median([ratio for ratio, _ in short]):.2f}" if short else "",
        percent([ratio / expected for ratio, expected in short]),
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("data", type=Path, help="folder of NPZ files")
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--per-file", type=int, default=12, help="problems of each file")
    parser.add_argument("--slack", type=float, default=missing.DEFAULT_SLACK)
    parser.add_argument("--only", help="one system")
    arguments = parser.parse_args()
    missing.set_slack(arguments.slack)
    groups = {
        "real": list(real_problems(arguments.data, arguments.per_file)),
        "synthetic": list(synthetic_problems()),
    }
    groups["no model"] = [p for p in groups["synthetic"] if p.source == "no model"]
    groups["synthetic"] = [p for p in groups["synthetic"] if p.source != "no model"]
    print(f"Slack {arguments.slack}. Problems: { ({k: len(v) for k, v in groups.items()}) }")
    print()
    heads = "good enough", "ms", "µs more", "cost", "missing", "N_e/N_a", "time", "beyond N_e/N_a"
    print(f"| function | {' | '.join(heads)} |")
    print("| --- " * (len(heads) + 1) + "|")
    for system, calls in LIBRARIES.items():
        if arguments.only not in (None, system):
            continue
        for (kind, name), call in calls().items():
            for group, problems in groups.items():
                costs = [
                    measure(call, system, problem, arguments.repeat)
                    for problem in problems
                    if problem.kind == kind
                ]
                if costs:
                    print(row(f"{name}, {group}", costs), flush=True)


if __name__ == "__main__":
    main()

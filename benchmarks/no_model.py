"""What exactness costs where there is no model at all.

    python benchmarks/no_model.py [--seconds S] [--output docs/no-model.md]

Measurements without a model leave the best support about k, where the exact number of trials is
furthest above the approximate one. The libraries run on pure noise, bare and with the drop-ins,
without a finite cap (``max_trials=inf``) and with one, at s = 0.99. The bound of a run can only
grow by the factor (n**k / I**k) / (C(n,k) / C(I,k)), which stays under k**k / k!; where there are
fewer inliers than a sample holds the library's own bound stands unless the user set a finite cap,
which then decides. Each run is stopped after S seconds, and its row says so: the trials it had
made by then, and the bound that was in force.
"""

import argparse
import math
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from skimage.measure import LineModelND, ransac
from skimage.transform import AffineTransform, ProjectiveTransform
from sklearn.linear_model import RANSACRegressor

from ransac_fix.patches.scikit_image import ransac as exact_ransac
from ransac_fix.patches.scikit_learn import RANSACRegressor as ExactRegressor

_HEAD = """\
# What exactness costs where there is no model

Made on {date} by `python benchmarks/no_model.py`: scikit-image's `ransac` and scikit-learn's
`RANSACRegressor` on pure noise at s = 0.99, bare and with the exact drop-ins, without a finite cap
on trials and with one.

- *I* is the largest support the bare run found, *bare* and *exact* are trials counted. *Limit* is
  k**k / k!, which the ratio of the two bounds cannot exceed where I >= k.
- Where there are fewer inliers than a sample holds (I < k, the last two rows), no number of
  trials is enough: without a cap the library's own bound stands, and with one the cap decides.
- Runs were stopped after {seconds:g} seconds: there the library's own bound is out of reach too.

"""


class OutOfTimeError(Exception):
    """Raised in a run that has used up its time."""


class Watch:
    """Called once a trial: counts, and ends the run when its time is up."""

    def __init__(self, seconds: float) -> None:
        self.trials = 0
        self._end = time.perf_counter() + seconds

    def __call__(self, *_: Any) -> bool:
        self.trials += 1
        if time.perf_counter() > self._end:
            raise OutOfTimeError
        return True


def scikit_image(
    model: type, n: int, size: int, threshold: float
) -> Callable[[bool, float, Watch], int]:
    def run(exact: bool, cap: float, watch: Watch) -> int:
        rng = np.random.default_rng(0)
        data: Any = rng.uniform(0, 100, (n, 2))
        if model is not LineModelND:
            data = (data, rng.uniform(0, 100, (n, 2)))
        function = exact_ransac if exact else ransac
        settings = {"stop_probability": 0.99, "max_trials": cap, "rng": 0}
        _, mask = function(data, model, size, threshold, is_data_valid=watch, **settings)
        return 0 if mask is None else int(np.count_nonzero(mask))

    return run


def scikit_learn(n: int, size: int, threshold: float) -> Callable[[bool, float, Watch], int]:
    def run(exact: bool, cap: float, watch: Watch) -> int:
        rng = np.random.default_rng(0)
        x, y = rng.uniform(0, 100, (n, 1)), rng.uniform(0, 100, n)
        cls = ExactRegressor if exact else RANSACRegressor
        regressor = cls(
            min_samples=size,
            residual_threshold=threshold,
            max_trials=cap,
            random_state=0,
            is_data_valid=watch,
        )
        return int(np.count_nonzero(regressor.fit(x, y).inlier_mask_))

    return run


# name, n, k, run. The last of each library: samples larger than minimal, I < k.
CASES = [
    ("scikit-image, line", 20, 2, scikit_image(LineModelND, 20, 2, 1e-3)),
    ("scikit-image, affine", 12, 3, scikit_image(AffineTransform, 12, 3, 1e-3)),
    ("scikit-image, homography", 10, 4, scikit_image(ProjectiveTransform, 10, 4, 1e-3)),
    ("scikit-image, homography", 100, 4, scikit_image(ProjectiveTransform, 100, 4, 1e-3)),
    ("scikit-image, line by 8 points", 12, 8, scikit_image(LineModelND, 12, 8, 15.0)),
    ("scikit-learn, line", 20, 2, scikit_learn(20, 2, 1e-3)),
    ("scikit-learn, line by 8 points", 12, 8, scikit_learn(12, 8, 25.0)),
]


def measure(
    run: Callable[[bool, float, Watch], int], exact: bool, cap: float, seconds: float
) -> tuple[int, float, int | None]:
    """Return trials, seconds, and the inliers found, None where time ran out."""
    watch = Watch(seconds)
    start = time.perf_counter()
    try:
        inliers: int | None = run(exact, cap, watch)
    except OutOfTimeError:
        inliers = None
    return watch.trials, time.perf_counter() - start, inliers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    lines = [
        "| case | n | k | cap | I | bare | exact | ratio | limit | s, bare | s, exact |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, n, size, run in CASES:
        for cap in (math.inf, 1000):
            bare = measure(run, False, cap, options.seconds)
            exact = measure(run, True, cap, options.seconds)
            stopped = [" (stopped)" if result[2] is None else "" for result in (bare, exact)]
            ratio = f"{exact[0] / bare[0]:.2f}" if not any(stopped) else ""
            inliers = bare[2] if bare[2] is not None else ""
            lines.append(
                f"| {name} | {n} | {size} | {cap} | {inliers} | {bare[0]}{stopped[0]} |"
                f" {exact[0]}{stopped[1]} | {ratio} | {size**size / math.factorial(size):.1f} |"
                f" {bare[1]:.2f} | {exact[1]:.2f} |"
            )
            print(lines[-1], flush=True)
    if options.output:
        today = datetime.now(UTC).date().isoformat()
        head = _HEAD.format(date=today, seconds=options.seconds)
        options.output.write_text(head + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()

"""The reference beside scikit-image's RANSAC and models, on the images in its wheel.

scikit-image's loop differs in its stopping rule alone: on the same samples and with the same
rule, both must take the same trials to the same inliers.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage
from skimage import color, feature, measure, transform
from skimage.io import imread

from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.reference import (
    Affine,
    Circle,
    Ellipse,
    FloatArray,
    Homography,
    IndexArray,
    Line,
    ransac,
)

IMAGES = Path(skimage.__file__).parent / "data"


class ChoiceSampler:
    """Draw as scikit-image's loop does, so that both see the same samples."""

    def __init__(self, n_samples: int, sample_size: int) -> None:
        self.n_samples, self.sample_size = n_samples, sample_size

    def draw(self, rng: np.random.Generator) -> IndexArray:
        return rng.choice(self.n_samples, self.sample_size, replace=False)


@pytest.fixture(scope="module")
def matches() -> FloatArray:
    """Return matches of a stereo pair, about a third of them on one plane."""
    found = []
    for side in ("left", "right"):
        image = color.rgb2gray(imread(IMAGES / f"motorcycle_{side}.png")[..., :3])
        orb = feature.ORB(n_keypoints=300)
        orb.detect_and_extract(image[:, 150:600])
        found.append((orb.keypoints[:, ::-1], orb.descriptors))
    (left, one), (right, other) = found
    pairs = feature.match_descriptors(one, other, cross_check=True)
    rows: FloatArray = np.hstack((left[pairs[:, 0]], right[pairs[:, 1]])).astype(np.float64)
    return rows


@pytest.fixture(scope="module")
def outlines() -> list[FloatArray]:
    """Return the edge points of coins, with other edges that touch them."""
    edges = feature.canny(imread(IMAGES / "coins.png"), sigma=3)
    regions = measure.regionprops(measure.label(edges, connectivity=2))
    return [r.coords[:, ::-1].astype(np.float64) for r in regions if 120 < r.area < 260]


def with_scikit_image(
    parts: Any, kind: type, k: int, threshold: float, confidence: float, seed: int
) -> tuple[Any, int]:
    """Return scikit-image's inliers and the trials it took."""
    trials = 0

    def count(*_: object) -> bool:
        nonlocal trials
        trials += 1
        return True

    _, inliers = measure.ransac(
        parts,
        kind,
        min_samples=k,
        residual_threshold=threshold,
        max_trials=5000,
        stop_probability=confidence,
        is_data_valid=count,
        rng=seed,
    )
    return inliers, trials


def check_against_scikit_image(
    data: FloatArray, model: Any, kind: type, parts: Any, threshold: float, seeds: range
) -> None:
    n, k = len(data), model.sample_size
    differing = 0
    for seed in seeds:
        for confidence in (0.9, 0.999):

            def ours(rule: Callable[..., int | float], s: float = confidence, seed: int = seed):  # type: ignore[no-untyped-def]
                return ransac(
                    data,
                    model,
                    residual_threshold=threshold,
                    confidence=s,
                    max_trials=5000,
                    sampler=ChoiceSampler(n, k),
                    stopping_rule=rule,
                    rng=seed,
                )

            inliers, trials = with_scikit_image(parts, kind, k, threshold, confidence, seed)
            same_rule, exact = ours(approximate_required_trials), ours(required_trials)
            assert same_rule.trials == trials
            assert same_rule.n_inliers == np.count_nonzero(inliers)
            differing += bool((same_rule.inliers != inliers).any())
            assert exact.trials >= same_rule.trials
            assert exact.n_inliers >= same_rule.n_inliers
            assert exact.trials >= required_trials(exact.n_inliers, n, k, confidence)
    # Of models with equally many inliers scikit-image prefers that with smaller residuals.
    assert differing <= len(seeds) // 2


def test_affine_maps_of_a_stereo_pair(matches: FloatArray) -> None:
    parts = (matches[:, :2], matches[:, 2:])
    check_against_scikit_image(matches, Affine(), transform.AffineTransform, parts, 2.0, range(10))


def test_homographies_of_a_stereo_pair(matches: FloatArray) -> None:
    parts = (matches[:, :2], matches[:, 2:])
    check_against_scikit_image(
        matches, Homography(), transform.ProjectiveTransform, parts, 2.0, range(6)
    )


def test_circles_around_coins(outlines: list[FloatArray]) -> None:
    assert len(outlines) >= 20
    for outline in outlines[:4]:
        check_against_scikit_image(outline, Circle(), measure.CircleModel, outline, 1.0, range(10))


def test_lines_along_coins(outlines: list[FloatArray]) -> None:
    for outline in outlines[:2]:
        check_against_scikit_image(outline, Line(), measure.LineModelND, outline, 0.8, range(10))


def test_residuals_and_fits_agree(outlines: list[FloatArray], matches: FloatArray) -> None:
    for outline in outlines[:5]:
        line, circle = Line().refit(outline), Circle().refit(outline)
        assert line is not None
        assert circle is not None
        theirs = measure.LineModelND.from_estimate(outline)
        np.testing.assert_allclose(
            Line().residuals(line, outline), theirs.residuals(outline), atol=1e-9
        )
        np.testing.assert_allclose(
            Circle().residuals(circle, outline),
            np.abs(measure.CircleModel(circle[:2], circle[2]).residuals(outline)),
            atol=1e-9,
        )
        ellipse = ransac(outline, Ellipse(), residual_threshold=1.5, rng=0).refit
        assert ellipse is not None
        np.testing.assert_allclose(
            Ellipse().residuals(ellipse, outline),
            measure.EllipseModel(ellipse[:2], ellipse[2:4], ellipse[4]).residuals(outline),
            atol=1e-6,
        )
        # The geometric fits lie no farther from their points than the algebraic ones.
        algebraic = measure.CircleModel.from_estimate(outline)
        assert np.sum(Circle().residuals(circle, outline) ** 2) <= np.sum(
            algebraic.residuals(outline) ** 2
        )
    plane = matches[ransac(matches, Homography(), residual_threshold=2.0, rng=0).inliers]
    maps = ((Affine(), transform.AffineTransform), (Homography(), transform.ProjectiveTransform))
    for model, kind in maps:
        fitted: Any = model.refit(plane)
        theirs = kind.from_estimate(plane[:, :2], plane[:, 2:])
        ours = np.sum(model.residuals(fitted, plane) ** 2)
        assert ours <= np.sum(theirs.residuals(plane[:, :2], plane[:, 2:]) ** 2)

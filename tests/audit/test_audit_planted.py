"""The planted problems hold what they say and nothing else."""

import itertools

import numpy as np
import pytest

from ransac_fix.audit.worker.planted import CLUTTER, PROBLEMS, plant


def residuals_of_fit(problem, x, y, sample):
    """Fit the model of a problem to a sample by least squares; residuals of everything."""
    if problem == "similarity":
        zeros, ones = np.zeros(len(x)), np.ones(len(x))
        rows_u = np.column_stack([x[:, 0], -x[:, 1], ones, zeros])
        rows_v = np.column_stack([x[:, 1], x[:, 0], zeros, ones])
        a = np.vstack([rows_u[sample], rows_v[sample]])
        b = np.concatenate([y[sample, 0], y[sample, 1]])
        solution = np.linalg.lstsq(a, b, rcond=None)[0]
        fitted = np.column_stack([rows_u @ solution, rows_v @ solution])
    else:
        a = np.column_stack([x, np.ones(len(x))])
        fitted = a @ np.linalg.lstsq(a[sample], y[sample], rcond=None)[0]
    return np.abs(fitted - y).max(axis=1)


SIZES = {"line": 2, "affine": 3, "homography": 4, "similarity": 2}


@pytest.mark.parametrize("problem", sorted(SIZES))
def test_groups_agree_and_are_as_large_as_asked(problem):
    k = SIZES[problem]
    for seed in range(20):
        planted = plant(problem, 18, k + 1, 2, k + 2, seed)
        counts = np.bincount(planted.labels[planted.labels != CLUTTER])
        assert counts.tolist() == [k + 1, k + 1, k + 2]
        for label in range(3):
            members = np.flatnonzero(planted.labels == label)
            residuals = residuals_of_fit(problem, planted.x, planted.y, members)
            assert residuals[members].max() < planted.threshold / 100


@pytest.mark.parametrize("problem", ["line", "affine", "similarity"])
def test_no_sample_across_groups_meets_a_further_measurement(problem):
    """Consensus outside the groups is the sample itself: nothing governs the rule by accident."""
    k = SIZES[problem]
    met = 0
    for seed in range(10):
        planted = plant(problem, 12, k + 1, 1, k + 2, seed)
        for sample in itertools.combinations(range(12), k):
            labels = set(planted.labels[list(sample)].tolist())
            if len(labels) == 1 and CLUTTER not in labels:
                continue
            residuals = residuals_of_fit(problem, planted.x, planted.y, list(sample))
            met += int((residuals < planted.threshold).sum()) > k
    assert met <= 2


def test_single_precision_changes_nothing():
    # No choice of numbers makes rotations, projections and circles exact; their thresholds allow
    # for it.
    exact = set(PROBLEMS) - {
        *("essential", "rotation", "translation_direction", "absolute_pose", "absolute_position"),
        *("rigid3d", "similarity3d", "circle", "sphere"),
    }
    for problem in sorted(exact):
        for seed in range(10):
            planted = plant(problem, 24, 9, 1, 10, seed)
            assert np.array_equal(planted.x.astype(np.float32), planted.x)
            assert np.array_equal(planted.y.astype(np.float32), planted.y)


def test_orientation_filters_pass_every_sample():
    """OpenCV redraws four points whose triangles turn differently in the two images."""
    for seed in range(10):
        planted = plant("homography", 15, 5, 1, 6, seed)
        for sample in itertools.combinations(range(15), 3):
            signs = []
            for points in (planted.x, planted.y):
                a, b, c = points[list(sample)]
                signs.append(np.sign((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]))
            assert signs[0] == signs[1] != 0


def test_a_group_is_recognised_only_when_whole_and_alone():
    planted = plant("line", 12, 3, 2, 4, 0)
    b = planted.labels == 2
    assert planted.group_of(b) == 2
    assert planted.group_of(planted.labels == 0) == 0
    assert planted.group_of(None) is None
    assert planted.group_of(np.zeros(12, dtype=bool)) is None
    one_more = b.copy()
    one_more[np.flatnonzero(~b)[0]] = True
    assert planted.group_of(one_more) is None
    one_less = b.copy()
    one_less[np.flatnonzero(b)[0]] = False
    assert planted.group_of(one_less) is None


def test_the_seed_fixes_everything():
    first, again, other = (plant("affine", 14, 4, 2, 5, seed) for seed in (3, 3, 4))
    assert np.array_equal(first.y, again.y)
    assert np.array_equal(first.labels, again.labels)
    assert not np.array_equal(first.y, other.y)


def test_groups_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        plant("line", 5, 3, 1, 4, 0)

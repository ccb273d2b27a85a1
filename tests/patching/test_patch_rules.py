"""The exact rule in a library's own conventions, and the bounds it keeps."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ransac_fix import required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.rules import exact_rule, examine

EPSILON = float(np.spacing(1))


def float_rule(n_inliers: Any, n_samples: Any, size: Any, probability: Any) -> float:
    """A rule that clips the numerator and returns Python floats."""
    nom = max(EPSILON, 1 - probability)
    denom = max(EPSILON, 1 - (n_inliers / n_samples) ** size)
    if nom == 1:
        return 0
    if denom == 1:
        return math.inf
    return float(math.ceil(math.log(nom) / math.log(denom)))


def numpy_rule(n_inliers: Any, n_samples: Any, size: Any, probability: Any) -> Any:
    """A rule that clips numerator and denominator and returns NumPy floats."""
    if probability == 0:
        return 0
    if n_inliers == 0:
        return np.inf
    nom = np.clip(1 - probability, EPSILON, 1 - EPSILON)
    denom = np.clip(1 - (n_inliers / n_samples) ** size, EPSILON, 1 - EPSILON)
    return np.ceil(np.log(nom) / np.log(denom))


def int_rule(n_inliers: Any, n_samples: Any, size: Any, probability: Any) -> float:
    """A rule that returns integers, and infinity for certainty."""
    p = (n_inliers / n_samples) ** size
    if probability == 1 or p == 0:
        return math.inf
    return 1 if p == 1 else math.ceil(math.log(1 - probability) / math.log1p(-p))


def unguarded_rule(n_inliers: Any, n_samples: Any, size: Any, probability: Any) -> float:
    """A rule without any guard, not rounded."""
    return math.log(1 - probability) / math.log(1 - (n_inliers / n_samples) ** size)


RULES: dict[str, Callable[..., Any]] = {
    rule.__name__: rule for rule in (float_rule, numpy_rule, int_rule, unguarded_rule)
}
NUMBER = {"float_rule": float, "numpy_rule": np.float64, "int_rule": int, "unguarded_rule": float}


def make(name: str, **options: Any) -> Callable[..., Any]:
    rule = RULES[name]
    return exact_rule(rule, examine(rule, name), **options)


counts = st.integers(1, 8).flatmap(
    lambda k: st.integers(k + 1, 200).flatmap(
        lambda n: st.tuples(st.integers(k, n - 1), st.just(n), st.just(k))
    )
)
confidences = st.one_of(st.floats(0.01, 0.999999), st.sampled_from([0.5, 0.9, 0.95, 0.99]))


@pytest.mark.parametrize("name", RULES)
@given(counts, confidences)
def test_exact_to_the_trial(name: str, count: tuple[int, int, int], confidence: float) -> None:
    value = make(name)(*count, confidence)
    limit = examine(RULES[name], name).limit
    wanted = required_trials(*count, confidence)
    if limit is None or wanted < limit / 100:
        assert value == wanted
    assert type(value) is NUMBER[name]


@pytest.mark.parametrize("name", RULES)
@given(counts, confidences)
def test_never_less_and_never_more_than_the_known_factor(
    name: str, count: tuple[int, int, int], confidence: float
) -> None:
    """N_e / N_a stays under k**k / k!, the limit for I = k and n to infinity."""
    n_inliers, n_samples, size = count
    p = (n_inliers / n_samples) ** size
    if p < 1e-12:
        return
    approximate = math.log(1 - confidence) / math.log1p(-p)
    value = make(name)(*count, confidence)
    assert approximate - 1e-6 <= value
    assert value <= approximate * size**size / math.factorial(size) * (1 + 1e-9) + 1


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize(
    "case", [(7, 12, 8, 0.99), (3, 20, 10, 0.5), (0, 9, 2, 0.9), (1, 9, 2, 0.9)]
)
def test_fewer_inliers_than_a_sample(name: str, case: tuple[int, int, int, float]) -> None:
    """Without a finite cap the library's own value stands, with one the cap decides."""
    rule = RULES[name]
    try:
        own: object = rule(*case)
    except ZeroDivisionError:
        with pytest.raises(ZeroDivisionError):
            make(name)(*case)
        return
    assert make(name)(*case) == own
    capped = make(name, running_limit=lambda: 1000.0)(*case)
    assert capped == (own if case[0] == 0 else math.inf)


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize(
    "case",
    [
        (5, 10, 2, 0),
        (5, 10, 2, 0.0),
        (10, 10, 2, 0.0),
        (5, 10, 2, 1),
        (5, 10, 2, 1.0),
        (0, 10, 2, 0.5),
    ],
)
def test_guards_are_the_librarys(name: str, case: tuple[int, int, int, float]) -> None:
    rule, exact = RULES[name], make(name)
    try:
        own = rule(*case)
    except (ValueError, ZeroDivisionError) as error:
        with pytest.raises(type(error)):
            exact(*case)
        return
    if case[3] == 1 and math.isfinite(own):
        # Certainty stands for a confidence a little below one.
        assert exact(*case) == required_trials(*case[:3], 1 - EPSILON)
    else:
        assert exact(*case) == own


def test_its_own_value_for_a_smaller_model_is_no_cap_of_the_users() -> None:
    """A loop without a cap: the bound set for 5 inliers gives way to the one for 6, and 7."""
    limit = math.inf
    exact = make("float_rule", running_limit=lambda: limit)
    for n_inliers in (5, 6, 7):
        limit = min(limit, exact(n_inliers, 12, 8, 0.99))
        assert limit == float_rule(n_inliers, 12, 8, 0.99)


def test_limits_are_the_librarys() -> None:
    exact = make("numpy_rule")
    for confidence in (0.5, 0.99, 1):
        beyond = exact(4, 10**7, 4, confidence)
        assert beyond == pytest.approx(numpy_rule(1, 10**18, 4, confidence), rel=1e-12)
    assert make("float_rule")(4, 10**7, 4, 0.5) == float(required_trials(4, 10**7, 4, 0.5))


def test_numpy_and_whole_float_arguments() -> None:
    exact = make("float_rule")
    assert exact(np.int64(6), 20, np.float64(2.0), 0.99) == 56.0
    assert exact(np.int64(6), np.int32(20), 2, np.float64(0.99)) == 56.0
    # Not a size that a sample can have: the library's own affair.
    assert exact(6, 20, 2.5, 0.99) == float_rule(6, 20, 2.5, 0.99)


def test_keywords_are_the_originals() -> None:
    exact = make("float_rule")
    assert exact(6, 20, probability=0.99, size=2) == 56.0
    with pytest.raises(TypeError):
        exact(6, 20, confidence=0.99, size=2)


@pytest.mark.parametrize("name", RULES)
def test_facts(name: str) -> None:
    facts = examine(RULES[name], name)
    assert facts.assumes == "approximate"
    assert facts.number is NUMBER[name]
    assert (facts.highest_confidence is None) is (name in ("int_rule", "unguarded_rule"))
    assert (facts.limit is not None) is (name == "numpy_rule")


def test_an_exact_rule_is_known_as_such() -> None:
    assert examine(required_trials, "required_trials").assumes == "exact"


@pytest.mark.parametrize(
    "rule",
    [
        lambda i, n, k, s: float_rule(i, n, k, s) * 1.5,
        lambda i, n, k, s: float_rule(i, n, k - 1, s),
        lambda i, n, k, s: float(required_trials(i + 1, n, k, s)),
        lambda i, n, k, s: math.log(1 - s) / math.log(1 - float(Fraction(math.perm(i, k), n**k))),
        lambda i, n, k, s: None,
        lambda i, n, k, s: "many",
    ],
    ids=["a multiplier", "another exponent", "one inlier more", "replacement", "None", "text"],
)
def test_other_rules_are_refused(rule: Callable[..., Any]) -> None:
    with pytest.raises(PatchNotApplicable, match="neither the approximate nor the exact"):
        examine(rule, "rule")

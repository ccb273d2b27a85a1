"""pydegensac: `findHomography` and `findFundamentalMatrix`.

The rule has the exact form, but takes the number of inliers plus one: it promises that no larger
model was missed, and stops at up to (I + 1 - k) / (I + 1) of the trials after which none of the
same size was. Here all rules are judged by the latter. Samples are distinct and uniform.

The rule is compiled in, so the functions are wrapped: see `ransac_fix.patching.wrapping`. The
missing trials are drawn with another seed and a confidence of 1, which runs all of them; the
model with more inliers is kept. Releases without a seed are refused: what cannot be repeated
cannot be checked.
"""

import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

from ransac_fix.criterion import all_inlier_probability, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.behaviour import assumed_probability
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import Spare, own_function
from ransac_fix.patching.wrapping import seeded

__all__ = ["PATCH"]

_SAMPLE_SIZES = {"findHomography": 4, "findFundamentalMatrix": 7}
# What the rule never exceeds.
_MOST_TRIALS = 1_000_000
_SPARE = Spare(8)


def _assumed(n_inliers: int, n_samples: int, sample_size: int) -> float:
    """Return the chance that the rule works with."""
    if n_inliers >= n_samples - 1:
        return 1.0 - 2.0**-53
    return all_inlier_probability(n_inliers + 1, n_samples, sample_size)


def _trials(
    n_inliers: int, n_samples: int, sample_size: int, confidence: float, limit: float
) -> float:
    """Return what pydegensac's own rule asks for with `n_inliers` in hand, up to its limits."""
    if n_inliers >= n_samples - 1:
        rule: float = 1
    elif n_inliers + 1 < sample_size or confidence >= 1:
        rule = _MOST_TRIALS
    elif confidence <= 0:
        rule = 0
    else:
        rule = required_trials(n_inliers + 1, n_samples, sample_size, confidence)
    return max(1, min(rule, _MOST_TRIALS, limit))


def _wrap(original: Callable[..., Any], sample_size: int) -> Callable[..., Any]:
    """Return the exact function."""
    from numpy import count_nonzero  # a third of the time of `sum`

    def read(
        result: tuple[Any, Any], n_samples: int, confidence: float, limit: float
    ) -> tuple[int, float]:
        n_inliers = int(count_nonzero(result[1]))
        return n_inliers, _trials(n_inliers, n_samples, sample_size, confidence, limit)

    parameters = inspect.signature(original).parameters
    return seeded(
        original,
        tuple(parameters),
        {name: parameter.default for name, parameter in parameters.items()},
        sample_size,
        points="pts1_",
        confidence="conf",
        read=read,
        spare=_SPARE,
        assumed=_assumed,
    )


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: both functions."""
    originals = {}
    for name in _SAMPLE_SIZES:
        original = own_function(module, name)
        if original is None:
            raise PatchNotApplicable(f"pydegensac has no {name}")
        parameters = inspect.signature(original).parameters
        for parameter in ("pts1_", "conf", "max_iters", "seed"):
            if parameter not in parameters:
                raise PatchNotApplicable(f"pydegensac.{name} takes no {parameter}")
        originals[name] = original

    return tuple(
        Replacement(holder=module, name=name, exact=_wrap(original, _SAMPLE_SIZES[name]))
        for name, original in originals.items()
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: both functions, where they stop before the exact number."""
    wrapped = observe(module)
    find = own_function(module, "findHomography")
    assert find is not None

    def count(x: Any, y: Any, trials: int, confidence: float) -> int:
        _, mask = find(x, y, 0.05, confidence, trials, seed=1)
        return int(mask.sum())

    # On these problems the rule with I + 1 asks for the same as p**k.
    assumed = assumed_probability(count, 4)
    if assumed is None:
        raise PatchNotApplicable("findHomography follows neither its known rule nor the exact one")
    return () if assumed == "exact" else wrapped


PATCH = LibraryPatch(
    system="pydegensac",
    requirements=("pydegensac==0.3.0",),
    modules=("pydegensac",),
    plan=plan,
    observe=observe,
    wraps=True,
)

"""pydegensac: `findHomography` and `findFundamentalMatrix`.

The rule has the exact form, but takes the number of inliers plus one: it promises that no larger
model was missed, and stops at up to (I + 1 - k) / (I + 1) of the trials after which none of the
same size was. Here all rules are judged by the latter. Samples are distinct and uniform.

The rule is compiled in, so the functions are wrapped: see `ransac_fix.patching.missing`. The
missing trials are drawn with another seed and a confidence of 1, which runs all of them; the
model with more inliers is kept. Releases without a seed are refused: what cannot be repeated
cannot be checked.
"""

import inspect
import os
from collections.abc import Callable
from types import ModuleType
from typing import Any

from ransac_fix.criterion import all_inlier_probability, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.behaviour import assumed_probability
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import (
    Attempt,
    Promise,
    Spare,
    complete,
    fresh_seed,
    missing_trials,
    own_function,
    raised_confidence,
    slack,
    with_argument,
)

__all__ = ["PATCH"]

Result = tuple[Any, Any]

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

    parameters = inspect.signature(original).parameters
    names = tuple(parameters)
    defaults = {name: parameter.default for name, parameter in parameters.items()}

    def exact(*args: Any, **kwargs: Any) -> Any:
        settings = {**defaults, **dict(zip(names, args, strict=False)), **kwargs}
        confidence, limit = settings["conf"], settings["max_iters"]
        try:
            n_samples = len(settings["pts1_"])
            asked = raised_confidence(n_samples, sample_size, confidence, _SPARE, assumed=_assumed)
        except TypeError:  # pydegensac says what is wrong with them
            return original(*args, **kwargs)
        if asked != confidence:
            args, kwargs = with_argument(names, args, kwargs, "conf", asked)
        result = original(*args, **kwargs)
        if n_samples <= sample_size:
            return result

        def attempt(found: Result, confidence: float, limit: float) -> Attempt[Result]:
            n_inliers = int(count_nonzero(found[1]))
            trials = _trials(n_inliers, n_samples, sample_size, confidence, limit)
            return Attempt(found, n_inliers, trials)

        def is_better(new: Result, best: Result) -> bool:
            return bool(count_nonzero(new[1]) > count_nonzero(best[1]))

        first = attempt(result, asked, limit)
        promise = Promise(n_samples, sample_size, confidence, limit)
        if not missing_trials(
            first.n_inliers, n_samples, sample_size, confidence, first.trials, limit, slack()
        ):
            return result

        def run(trials: int, round_: int) -> Attempt[Result]:
            seed = settings["seed"]
            # Without a seed there is nothing to repeat.
            new = int.from_bytes(os.urandom(3)) if seed < 0 else fresh_seed(seed, round_)
            changes = {"conf": 1.0, "max_iters": trials, "seed": new}
            return attempt(original(**{**settings, **changes}), 1.0, trials)

        return complete(first, promise, run, is_better)

    return exact


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

"""Two kinds of function that are wrapped in the same way, whichever library they are from.

`seeded`: a confidence of 1 makes the function run all trials up to its limit, and a seed sets its
samples. `floored`: it has a minimum of trials, and no seed. For how trials are missed and drawn see
`ransac_fix.patching.missing`.
"""

import math
import os
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from ransac_fix.patching.missing import (
    Attempt,
    Chance,
    Promise,
    Spare,
    approximate_chance,
    complete,
    fresh_seed,
    missing_trials,
    raised_confidence,
    slack,
    with_argument,
)

__all__ = ["Settings", "floored", "seeded"]

Settings: TypeAlias = dict[str, Any]
"""The arguments of a call by name, defaults included."""


def seeded(
    original: Callable[..., Any],
    names: tuple[str, ...],
    defaults: Mapping[str, Any],
    sample_size: int,
    *,
    points: str,
    confidence: str,
    read: Callable[[Any, int, float, float], tuple[int, float]],
    spare: Spare | None = None,
    assumed: Chance = approximate_chance,
) -> Callable[..., Any]:
    """Return the exact function of one that takes ``max_iters`` and ``seed``.

    Parameters
    ----------
    original : callable
        The library's function. With a confidence of 1 it runs ``max_iters`` trials.
    names : tuple of str
        Its parameters in order.
    defaults : mapping
        Default values of the confidence, ``max_iters`` and ``seed`` at least. A seed of None or
        below 0 stands for no seed.
    sample_size : int
        Measurements in one sample.
    points, confidence : str
        The parameters that hold measurements, and the confidence.
    read : callable
        ``read(result, n_samples, confidence, max_iters)``: the number of inliers and the trials
        of a run. The library's own measure of a model is its inliers.
    spare, assumed
        As in `ransac_fix.patching.missing.raised_confidence`. Without `spare` the first run is as
        asked: for a library in which a second one costs no more than its trials.
    """

    def exact(*args: Any, **kwargs: Any) -> Any:
        settings = {**defaults, **dict(zip(names, args)), **kwargs}  # noqa: B905 -- fewer arguments
        wanted, limit = settings[confidence], settings["max_iters"]
        asked = wanted
        try:
            n_samples = len(settings[points])
            if spare is not None:
                asked = raised_confidence(n_samples, sample_size, wanted, spare, assumed=assumed)
        except (TypeError, KeyError):  # the library says what is wrong with them
            return original(*args, **kwargs)
        if asked != wanted:
            args, kwargs = with_argument(names, args, kwargs, confidence, asked)
        result = original(*args, **kwargs)
        if n_samples <= sample_size:
            return result
        n_inliers, trials = read(result, n_samples, asked, limit)
        if not missing_trials(n_inliers, n_samples, sample_size, wanted, trials, limit, slack()):
            return result

        def run(trials: int, round_: int) -> Attempt[Any]:
            seed = settings["seed"]
            if seed is None or seed < 0:  # nothing to repeat
                seed = int.from_bytes(os.urandom(3))
            else:
                seed = fresh_seed(seed, round_)
            changes = {confidence: 1.0, "max_iters": trials, "seed": seed}
            again = original(**{**settings, **changes})
            return Attempt(again, *read(again, n_samples, 1.0, trials))

        return complete(
            Attempt(result, n_inliers, trials), Promise(n_samples, sample_size, wanted, limit), run
        )

    return exact


def floored(
    original: Callable[..., Any],
    defaults: Mapping[str, Any],
    sample_size: int,
    *,
    points: str,
    is_ours: Callable[[Settings], bool],
    count: Callable[[Settings, Any], int],
    rule: Callable[[int, int, int, float], float],
    loss: Callable[[Settings, Any], float],
) -> Callable[..., Any]:
    """Return the exact function of one that takes ``conf``, ``min_iters`` and ``max_iters``.

    How many trials were run it does not say: they are what its rule asks for with the final
    model. There is no seed, so the missing ones are fresh samples; both bounds ask for them.

    Parameters
    ----------
    original : callable
        The library's function. Its result begins with the model, or with None.
    defaults : mapping
        Its parameters in order, with their default values.
    sample_size : int
        Measurements in one sample.
    points : str
        The parameter that holds measurements.
    is_ours : callable
        ``is_ours(settings)``: samples are drawn as the promise takes them to be.
    count : callable
        ``count(settings, result)``: inliers as the rule counts them.
    rule : callable
        ``rule(n_inliers, n_samples, sample_size, confidence)``: what the library's own asks for.
    loss : callable
        ``loss(settings, result)``: the library's measure of a model, which is to be small.
    """
    names = tuple(defaults)

    def exact(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        settings = {**defaults, **dict(zip(names, args)), **kwargs}  # noqa: B905 -- fewer arguments
        n_samples = len(settings[points])
        if n_samples <= sample_size or not is_ours(settings):
            return result
        confidence, limit = settings["conf"], settings["max_iters"]

        def attempt(found: Any, least: int, most: int) -> Attempt[Any]:
            n_inliers = count(settings, found)
            trials = rule(n_inliers, n_samples, sample_size, confidence)
            return Attempt(found, n_inliers, max(min(trials, most), least, 1))

        first = attempt(result, settings["min_iters"], limit)
        if not missing_trials(
            first.n_inliers, n_samples, sample_size, confidence, first.trials, limit, slack()
        ):
            return result

        def run(trials: int, _round: int) -> Attempt[Any]:
            both = {"min_iters": trials, "max_iters": trials}
            return attempt(original(**{**settings, **both}), trials, trials)

        def lost(found: Any) -> float:
            return math.inf if found[0] is None else loss(settings, found)

        return complete(
            first,
            Promise(n_samples, sample_size, confidence, limit),
            run,
            lambda new, best: lost(new) < lost(best),
        )

    return exact

"""Draw the trials that a compiled library left out.

A stopping rule inside compiled code cannot be replaced. Its wrapper runs the library, reads the
number of inliers from the result, and asks `missing_trials` whether the trials that the library's
own rule asked for keep the promise that its caller paid for. Where they do not, `complete` draws
the missing ones, and no others, on samples the first run has not seen, and keeps the better model
by the library's own measure.

A second run pays again for what every run begins and ends with. So the first one is asked for the
confidence that `raised_confidence` gives, at which most runs have no trials missing, and none
runs noticeably more than the exact number.

What the user set as a limit always wins: the first run and the missing trials together never
exceed it.
"""

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, expm1, inf, log1p
from types import ModuleType
from typing import Any, Generic, Literal, NamedTuple, TypeAlias, TypeVar

from ransac_fix.criterion import all_inlier_probability, required_trials
from ransac_fix.errors import RansacFixError, RansacFixWarning
from ransac_fix.patching.watching import CURRENT

__all__ = [
    "DEFAULT_SLACK",
    "Attempt",
    "Chance",
    "Promise",
    "Spare",
    "approximate_chance",
    "complete",
    "fresh_seed",
    "missing_trials",
    "own_function",
    "raised_confidence",
    "set_slack",
    "slack",
    "with_argument",
]

Result = TypeVar("Result")
Sampling: TypeAlias = Literal["distinct", "replacement"]
Chance: TypeAlias = Callable[[int, int, int], float]
"""``chance(n_inliers, n_samples, sample_size)``: that one sample holds inliers only."""

DEFAULT_SLACK = 0.1
SLACK_VARIABLE = "RANSAC_FIX_SLACK"

# What stands in for a limit where the user set none: the larger of a number of trials (the limit
# that COLMAP and PoseLib have by default) and a multiple of what the library ran.
_UNLIMITED = 2**31 - 1
_TRIALS_WITHOUT_LIMIT = 100_000
_RUNS_WITHOUT_LIMIT = 10

# A higher confidence is one of 1 to some libraries.
_HIGHEST_CONFIDENCE = 1.0 - 2.0**-50


@dataclass(frozen=True, slots=True)
class Promise:
    """What a call asks for, as `ransac_fix.criterion.required_trials` takes it.

    Parameters
    ----------
    n_samples, sample_size, confidence
        n, k and s of the call.
    max_trials : float
        The user's limit, or the library's default for it; infinity where there is none.
    sampling : "distinct" or "replacement", default "distinct"
        How the library draws a sample.
    """

    n_samples: int
    sample_size: int
    confidence: float
    max_trials: float
    sampling: Sampling = "distinct"


class Spare(NamedTuple):  # quicker to look up by than a frozen dataclass
    """By how much a first run may exceed the exact number, whatever it finds.

    Parameters
    ----------
    trials : float
        So many trials take a few percent of a short call.
    share : float
        And such a share of all trials a few percent of a long one.
    """

    trials: float
    share: float = 0.04


@dataclass(frozen=True, slots=True)
class Attempt(Generic[Result]):
    """One run of the library.

    Parameters
    ----------
    result : object
        What the library returned.
    n_inliers : int
        Inliers of its model; 0 where it found none.
    trials : int
        How many trials it ran. Where the library does not say, what its rule asks for with
        `n_inliers` in hand, up to its limit: it may have run more, never fewer.
    chance : float, optional
        The probability that one sample holds inliers only, where the library's sampler is of
        another kind than `Promise.sampling` can say.
    """

    result: Result
    n_inliers: int
    trials: float
    chance: float | None = None


def missing_trials(
    n_inliers: int,
    n_samples: int,
    sample_size: int,
    confidence: float,
    trials: float,
    max_trials: float,
    slack: float,
    sampling: Sampling = "distinct",
    chance: float | None = None,
) -> int:
    """Return how many more trials the promise needs: 0 where `trials` are good enough.

    Parameters
    ----------
    n_inliers : int
        Inliers of the model in hand. Fewer than `sample_size` count as `sample_size`: the model
        came from a sample, whatever a refinement has made of it since.
    n_samples, sample_size, confidence, max_trials, sampling
        As in `Promise`.
    trials : float
        Trials run so far.
    slack : float
        The relative excess of the failure probability over ``1 - confidence`` that is good
        enough.
    chance : float, optional
        As in `Attempt`.

    Returns
    -------
    int
        ``required_trials(...) - trials``, or what `max_trials` leaves of it. 0 also where
        `ransac_fix.trace` watches a call that is not to be made exact: it takes note.
    """
    watched = CURRENT.watched
    if watched is not None:
        watched.note(
            (n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance)
        )
        if not watched.exact:
            return 0
    if trials >= max_trials or n_samples < sample_size or confidence <= 0:
        return 0
    n_inliers = min(max(n_inliers, sample_size), n_samples)
    if slack > 0 and confidence < 1:
        hit = chance
        if hit is None:
            hit = all_inlier_probability(n_inliers, n_samples, sample_size, sampling=sampling)
        if hit < 1 and trials * log1p(-hit) <= log1p(-confidence) + log1p(slack):
            return 0
    if chance is None:
        needed = required_trials(n_inliers, n_samples, sample_size, confidence, sampling=sampling)
    elif 0 < chance < 1 and confidence < 1:
        needed = ceil(log1p(-confidence) / log1p(-chance))
    else:
        needed = 1 if chance > 0 else inf
    if trials >= needed:
        return 0
    left = min(needed, max_trials) - trials
    return int(left) if left < _UNLIMITED else _UNLIMITED


def approximate_chance(n_inliers: int, n_samples: int, sample_size: int) -> float:
    """Return the probability that most libraries assume, (I/n)**k."""
    return float((n_inliers / n_samples) ** sample_size)


def raised_confidence(
    n_samples: int,
    sample_size: int,
    confidence: float,
    spare: Spare,
    *,
    multiplier: float = 1.0,
    sampling: Sampling = "distinct",
    assumed: Chance = approximate_chance,
) -> float:
    """Return the confidence to ask of the first run.

    At confidence ``1 - (1 - s)**r`` a rule asks for r times as many trials. r is as large as it
    can be while no number of inliers makes the run exceed the exact number by more than `spare`.
    N_e / N_a falls as inliers grow in number, so what is still missing then are the trials of
    long runs, beside which the cost of a second one is small.

    Parameters
    ----------
    n_samples, sample_size, confidence, sampling
        As in `Promise`.
    spare : Spare
        What further trials may cost.
    multiplier : float, default 1
        What the library multiplies its number by.
    assumed : callable
        The probability that its rule assumes. A function of a module: results are kept by it.

    Returns
    -------
    float
        `confidence` where raising it serves nothing, and where `ransac_fix.trace` watches a call
        that is not to be made exact.
    """
    watched = CURRENT.watched
    if watched is not None and not watched.raising:
        return confidence
    if not 0 < confidence < 1 or n_samples <= sample_size or multiplier <= 0:
        return confidence
    # What is similar is asked once: five bits of n say enough. With more measurements r is less.
    shift = max(int(n_samples).bit_length() - 5, 0)
    return _raised(
        -(-n_samples >> shift) << shift,
        sample_size,
        confidence,
        spare,
        multiplier,
        sampling,
        assumed,
        _slack,
    )


@lru_cache(maxsize=8192)
def _raised(
    n_samples: int,
    sample_size: int,
    confidence: float,
    spare: Spare,
    multiplier: float,
    sampling: Sampling,
    assumed: Chance,
    slack: float,
) -> float:
    """Return what `raised_confidence` does, for settings in which it can be raised."""
    failure = log1p(-confidence)
    accepted = min(failure + log1p(slack), 0.0)
    least = inf
    for n_inliers in range(sample_size, n_samples, max(n_samples // 32, 1)):
        chance = all_inlier_probability(n_inliers, n_samples, sample_size, sampling=sampling)
        own = multiplier * failure / log1p(-assumed(n_inliers, n_samples, sample_size))
        most = (1.0 + spare.share) * accepted / log1p(-chance) + spare.trials
        least = min(least, most / own)
    raised = -expm1(least * failure)
    return raised if confidence < raised < _HIGHEST_CONFIDENCE else confidence


def complete(
    first: Attempt[Result],
    promise: Promise,
    run: Callable[[int, int], Attempt[Result]],
    is_better: Callable[[Result, Result], bool] | None = None,
) -> Result:
    """Return the library's result, after the missing trials where there are any.

    Parameters
    ----------
    first : Attempt
        The run that the user asked for.
    promise : Promise
        What it was to keep.
    run : callable
        ``run(trials, round)`` runs the library for so many trials on fresh samples; `round`
        counts from 1, to derive a seed or a permutation from. A library whose rule cannot be
        kept from stopping early may run fewer trials: it is called again for the rest.
    is_better : callable, optional
        ``is_better(new, best)`` compares two results by the library's own measure: the number of
        inliers, where not given. Ties keep the earlier result.

    Returns
    -------
    object
        The result of `first`, the same object, unless a later run found a better model.

    Warns
    -----
    RansacFixWarning
        Where there is no limit on trials and the exact number was cut short.
    """
    best, trials, runs = first, first.trials, 0
    limit = promise.max_trials
    if limit >= _UNLIMITED:
        limit = max(_TRIALS_WITHOUT_LIMIT, _RUNS_WITHOUT_LIMIT * first.trials)
    while missing := missing_trials(
        best.n_inliers,
        promise.n_samples,
        promise.sample_size,
        promise.confidence,
        trials,
        limit,
        _slack,
        promise.sampling,
        best.chance,
    ):
        runs += 1
        attempt = run(missing, runs)
        trials += max(attempt.trials, 1)
        if is_better is None:
            better = attempt.n_inliers > best.n_inliers
        else:
            better = is_better(attempt.result, best.result)
        if better:
            best = attempt
    if runs and limit != promise.max_trials and trials >= limit:
        warnings.warn(
            f"stopped after {trials:.0f} trials with {best.n_inliers} of {promise.n_samples}"
            " inliers, before the exact number: set a maximum number of trials to choose another"
            " bound",
            RansacFixWarning,
            stacklevel=4,
        )
    return best.result


def fresh_seed(seed: int, round_: int) -> int:
    """Return the seed of a later run: another one for every round, the same on every call."""
    return (seed * 6364136223846793005 + round_ * 1442695040888963407 >> 16) & 0x7FFFFFFF


def with_argument(
    names: tuple[str, ...],
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
    name: str,
    value: object,
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Return the arguments of a call with one of them changed, and all else as it was given.

    Parameters
    ----------
    names : tuple of str
        The function's parameters in order.
    args, kwargs
        Those of the call.
    name : str
        The parameter to change, whether it was given or not.
    value : object
        Its new value.
    """
    place = names.index(name)
    if place < len(args):
        return (*args[:place], value, *args[place + 1 :]), kwargs
    return args, {**kwargs, name: value}


def own_function(holder: ModuleType | type, name: str) -> Callable[..., Any] | None:
    """Return a function of an imported library, without the stand-in that may be in its place.

    Parameters
    ----------
    holder : module or class
        Where the library keeps it.
    name : str
        Its name.

    Returns
    -------
    callable or None
        None where there is none of that name. What other code has put in its place is kept:
        the exact function calls it as the library's own.
    """
    function = getattr(holder, name, None)
    while getattr(function, "__ransac_fix__", False):
        function = getattr(function, "__wrapped__", None)
    return function if callable(function) else None


def slack() -> float:
    """Return the relative excess of failure probability that is accepted without more trials.

    0.1 unless set: with a confidence of 0.99, a failure probability of up to 1.1 % is accepted.
    """
    return _slack


def set_slack(value: float) -> None:
    """Set `slack`, in this process and in those started from it.

    Parameters
    ----------
    value : float
        0 for the exact number of trials.

    Raises
    ------
    RansacFixError
        If it is negative or not a number.
    """
    global _slack
    _slack = _checked(value, "slack")
    os.environ[SLACK_VARIABLE] = repr(_slack)


def _checked(value: object, name: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = -1.0
    if not 0 <= number < inf:
        raise RansacFixError(
            f"{name} must be a number that is not negative, such as 0.1, not {value!r}"
        )
    return number


_slack = _checked(os.environ.get(SLACK_VARIABLE, DEFAULT_SLACK), SLACK_VARIABLE)

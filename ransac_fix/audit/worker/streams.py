"""Flip points, counted trials and hit rates, read off one library function by running it.

The method and its symbols: t_B is the trial at which the larger model B is found, t_A the one at
which the smaller model A came in hand, u = -ln(1 - s), and u* the least u at which the rule still
lets trial t_B happen.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Settings
from ransac_fix.audit.worker.planted import Planted, evenly, plant

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

LARGEST_CONFIDENCE = 1 - 2.0**-53
SMALLEST_CONFIDENCE = 1e-12
# Above 25 the double that holds s steps by more than 1e-5 in u; below 0.01 the rule says one trial.
U_RANGE = (0.01, 25.0)
# A flip is known to this fraction of a trial.
RESOLUTION = 0.03
NOT_FOUND = "the larger model was not found within the budget"
NEVER_STOPS = "the rule never stops before the larger model"
BUDGET_REACHED = "the run reached its budget"
TOO_SHORT = "the run was too short"
FIXED_COUNT = "the count does not depend on the confidence"
ALWAYS_STOPS = "the rule stops before the larger model even at the highest confidence"
# Streams in vain, after which no others are tried; and the same of runs that count their trials
# and all reach a budget several times what a rule would ask for.
_HOPELESS = 20
_HOPELESS_BUDGETS = 8
# Runs of one stream that is another each time, at most, and how often the least count must come:
# runs that go on because A came late end anywhere.
_REPEATS = 16
_AGREEING = 4


@dataclass(frozen=True)
class Measured:
    """One exact point of a stopping rule.

    At ``u_low`` trial ``trials`` did not happen, at ``u_high`` it did, with a model of
    ``n_inliers`` in hand since trial ``in_hand``; ``strata`` are its inliers and the measurements
    of each stratum.
    """

    kind: str
    n_samples: int
    n_inliers: int
    trials: int
    in_hand: int
    u_low: float
    u_high: float
    seed: int
    strata: tuple[tuple[int, int], ...]


class Discarded(Exception):  # noqa: N818 -- not an error: this stream cannot show the rule
    """The stream cannot show the rule; the text says why."""


def confidence_of(u: float) -> float:
    """Confidence s with -ln(1-s) = u, at most the largest double below 1."""
    return min(-math.expm1(-u), LARGEST_CONFIDENCE)


def u_of(confidence: float) -> float:
    """U = -ln(1-s)."""
    return -math.log1p(-confidence)


class Stream:
    """One library function on one planted problem with one random stream.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    planted : Planted
        The data.
    seed : int
        Passed to the function.
    """

    def __init__(self, entry_point: EntryPoint, planted: Planted, seed: int) -> None:
        self.entry_point = entry_point
        self.planted = planted
        self.seed = seed
        self.runs = 0
        self.label_b = int(planted.labels.max())

    def run(self, max_trials: int, confidence: float) -> Outcome:
        """Run once with this budget and confidence."""
        self.runs += 1
        settings = Settings(max_trials, confidence)
        return self.entry_point.run(self.planted, settings, self.seed)

    def run_at_defaults(self) -> Outcome:
        """Run once with nothing set."""
        self.runs += 1
        return self.entry_point.run(self.planted, None, self.seed)

    def group(self, max_trials: int, confidence: float) -> int | None:
        """Label of the group found, or None."""
        return self.planted.group_of(self.run(max_trials, confidence).inliers)

    def finds_b(self, max_trials: int, confidence: float) -> bool:
        """Whether the larger model is what a run returns."""
        return self.group(max_trials, confidence) == self.label_b


def first_true(predicate: Callable[[int], bool], largest: int) -> int | None:
    """Smallest t in 1..largest for which a monotone predicate holds; None if it never does."""
    high = 1
    while not predicate(high):
        if high >= largest:
            return None
        high = min(4 * high, largest)
    return _first_between(0 if high == 1 else high // 4, high, predicate)


def _first_between(low: int, high: int, predicate: Callable[[int], bool]) -> int:
    """Smallest t above low for which a monotone predicate holds; it holds for high."""
    while high - low > 1:
        middle = (low + high) // 2
        if predicate(middle):
            high = middle
        else:
            low = middle
    return high


def _trial_of_b_after_a(stream: Stream, largest: int) -> int:
    """t_B: the trial at which B is found when nothing but the budget stops the run.

    Most streams find B without an A before, and show it as the budget is doubled: those are
    given up early.
    """
    budget, a_seen = 2, False
    while True:
        group = stream.group(budget, LARGEST_CONFIDENCE)
        if group == stream.label_b:
            break
        a_seen |= group is not None
        if budget >= largest:
            raise Discarded(NOT_FOUND)
        budget = min(2 * budget, largest)
    if not a_seen:
        raise Discarded("no smaller model was seen before the larger one")
    return _first_between(
        budget // 2, budget, lambda trials: stream.finds_b(trials, LARGEST_CONFIDENCE)
    )


def flip_point(stream: Stream, largest: int, smallest: int) -> Measured:
    """Measure one exact point (u*, t_B) of the stopping rule.

    Parameters
    ----------
    stream : Stream
        With A groups and a B.
    largest, smallest : int
        Accepted range of t_B.

    Returns
    -------
    Measured

    Raises
    ------
    Discarded
        If the stream cannot show the rule.
    """
    planted = stream.planted
    t_b = _trial_of_b_after_a(stream, largest)
    if t_b < smallest:
        raise Discarded("the larger model came too early")
    before = stream.run(t_b - 1, LARGEST_CONFIDENCE).inliers
    if planted.group_of(before) is None:
        raise Discarded("something other than the smaller model was in hand")
    assert before is not None
    n_inliers = int(before.sum())
    t_a = first_true(
        lambda t: planted.group_of(stream.run(t, LARGEST_CONFIDENCE).inliers) is not None, t_b - 1
    )
    if t_a is None or stream.finds_b(t_a, LARGEST_CONFIDENCE):
        raise Discarded("the stream depends on the budget")

    budget = 2 * t_b + 8

    def passes(u: float) -> bool:
        return stream.finds_b(budget, confidence_of(u))

    if not passes(U_RANGE[1]):
        raise Discarded(ALWAYS_STOPS)
    if passes(U_RANGE[0]):
        raise Discarded(NEVER_STOPS)
    low, high = U_RANGE
    while t_b * (high - low) / low > RESOLUTION:
        middle = math.sqrt(low * high)
        if passes(middle):
            high = middle
        else:
            low = middle
    rng = np.random.default_rng([stream.seed, t_b])
    for factor in rng.uniform(1.02, 2.0, 2):
        if passes(low / factor) or not passes(min(high * factor, U_RANGE[1])):
            raise Discarded("the outcome is not monotone in the confidence")
    if passes(low) or not passes(high):
        raise Discarded("the same run does not give the same outcome again")
    if not stream.finds_b(t_b + int(rng.integers(1, 20)), LARGEST_CONFIDENCE):
        raise Discarded("the stream depends on the budget")
    return Measured(
        "flip",
        planted.n_samples,
        n_inliers,
        t_b,
        t_a,
        u_of(confidence_of(low)),
        u_of(confidence_of(high)),
        stream.seed,
        planted.count(before),
    )


def counted_point(stream: Stream, largest: int, smallest: int, u: float) -> Measured:
    """Measure one exact point of the rule of a function whose trials can be counted.

    The planted problem holds no B: the rule acts on A's count, and the trials run at ``u`` are
    compared with those at slightly lower u until the step between two counts is known.

    Parameters
    ----------
    stream : Stream
        With A groups only.
    largest, smallest : int
        Accepted range of the count.
    u : float
        Where to begin.

    Returns
    -------
    Measured

    Raises
    ------
    Discarded
        If the stream cannot show the rule.
    """

    def trials(u: float) -> int:
        # A run ends when the rule says so for A's count, or when A comes if that is later: of
        # runs that cannot be repeated the shortest is taken.
        counts: list[int] = []
        for _ in range(1 if stream.entry_point.repeatable else _REPEATS):
            outcome = stream.run(largest, confidence_of(u))
            if outcome.trials is None:
                raise Discarded("the number of trials was not reported")
            if stream.planted.group_of(outcome.inliers) is not None:
                counts.append(outcome.trials)
                if counts.count(min(counts)) == _AGREEING:
                    break
        if not counts:
            raise Discarded("no smaller model was in hand")
        return min(counts)

    high = u
    count = trials(high)
    if count >= largest:
        raise Discarded(BUDGET_REACHED)
    if count < smallest:
        raise Discarded(TOO_SHORT)
    low = high * (1 - 2.5 / count)
    if trials(low) >= count:
        raise Discarded(FIXED_COUNT)
    while count * (high - low) / low > RESOLUTION:
        middle = (low + high) / 2
        if trials(middle) >= count:
            high = middle
        else:
            low = middle
    # Only A groups are planted, all alike, and one was in hand.
    of_a = stream.planted.labels == 0
    return Measured(
        "count",
        stream.planted.n_samples,
        int(of_a.sum()),
        count,
        0,
        u_of(confidence_of(low)),
        u_of(confidence_of(high)),
        stream.seed,
        stream.planted.count(of_a),
    )


def points(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Collect points of the stopping rule on one (n, m_A).

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``kind`` ("flip" or "count"), ``n_samples``, ``group_size``, ``n_groups``, ``wanted``
        (points), ``streams`` (to try at most), ``largest``, ``smallest`` (trials), ``seed``,
        ``strata`` (of `plant`).

    Returns
    -------
    dict
        ``points``, ``runs`` and ``discarded`` (reason -> how many streams).
    """
    found: list[dict[str, Any]] = []
    discarded: dict[str, int] = {}
    runs = 0
    counting = request["kind"] == "count"
    size = request["group_size"]
    for index in range(request["streams"]):
        endless = discarded.get(BUDGET_REACHED) == index == _HOPELESS_BUDGETS
        if len(found) >= request["wanted"] or (not found and index == _HOPELESS) or endless:
            break
        seed = request["seed"] + index
        planted = plant(
            entry_point.problem,
            request["n_samples"],
            size,
            request["n_groups"],
            0 if counting else size + 1,
            seed,
            strata=[(n, a, 0 if counting else b) for n, a, b in request["strata"]],
        )
        stream = Stream(entry_point, planted, seed)
        try:
            if counting:
                u = float(np.random.default_rng([seed, 7]).uniform(*request["u"]))
                point = counted_point(stream, request["largest"], request["smallest"], u)
            else:
                point = flip_point(stream, request["largest"], request["smallest"])
            found.append(asdict(point))
        except Discarded as why:
            discarded[str(why)] = discarded.get(str(why), 0) + 1
        runs += stream.runs
    return {"points": found, "runs": runs, "discarded": discarded}


def hits(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count how often B is found within a few trials, for the law of the sampler.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``cases``: list of ``[n_samples, size of B, trials, what comes first, strata]``, where
        the strata are pairs of the size of B and the measurements in each (evenly spread if
        there are none), ``seed``, ``watch``: whether the samples drawn may be looked at in place
        of what a run finds, and ``problem``: another planted problem than its own.

    Returns
    -------
    dict
        ``hits``: whether each run found the group; and ``runs``.
    """
    out = []
    watch = request.get("watch", False) and entry_point.draws is not None
    watched = _Watched(entry_point, request)
    for index, (n_samples, size, trials, first, strata) in enumerate(request["cases"]):
        seed = request["seed"] + index
        parts = [(n, inliers, 0) for inliers, n in strata] or evenly(
            n_samples, size, 0, entry_point.n_strata
        )
        problem = request.get("problem", entry_point.problem)
        planted = plant(problem, n_samples, size, 1, 0, seed, first=first, strata=parts)
        if watch:
            out.append(watched.hits(planted, trials))
        else:
            # Without a budget runs of one trial only are asked for.
            confidence = LARGEST_CONFIDENCE if entry_point.budget else SMALLEST_CONFIDENCE
            inliers = Stream(entry_point, planted, seed).run(trials, confidence).inliers
            out.append(_found(planted, inliers))
    return {"hits": out, "runs": watched.runs if watch else len(out)}


# Measurements from which on some of the clutter may agree with a group's model.
_LARGE = 500


def _found(planted: Planted, inliers: NDArray[np.bool_] | None) -> bool:
    """Whether the inliers are those of the one group planted."""
    if planted.n_samples < _LARGE:
        return planted.group_of(inliers) is not None
    members = planted.labels >= 0
    return inliers is not None and bool((inliers != members).sum() < 0.1 * members.sum())


class _Watched:
    """Samples that a library was seen to draw, each used once; one run provides those of an n."""

    def __init__(self, entry_point: EntryPoint, request: dict[str, Any]) -> None:
        self._entry_point = entry_point
        self._seed = request["seed"]
        self._wanted: dict[int, int] = {}
        for n, _, trials, *_ in request["cases"]:
            self._wanted[n] = self._wanted.get(n, 0) + trials
        self._samples: dict[int, NDArray[np.int64]] = {}
        self.runs = 0

    def hits(self, planted: Planted, trials: int) -> bool:
        """Whether one of the next samples holds distinct members of the group only."""
        n = planted.n_samples
        if n not in self._samples:
            assert self._entry_point.draws is not None
            self._samples[n] = self._entry_point.draws(n, self._wanted[n], self._seed)
            self.runs += 1
        samples, self._samples[n] = self._samples[n][:trials], self._samples[n][trials:]
        inside = (planted.labels[samples] == planted.labels.max()).all(axis=1)
        ordered = np.sort(samples, axis=1)
        distinct = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
        return bool((inside & distinct).any())


def larger(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count how often the larger of two groups is found at the highest confidence.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``n_samples``, ``group_size``, ``trials``, ``streams``, ``seed``.

    Returns
    -------
    dict
        ``found`` and ``runs``.
    """
    found = 0
    for index in range(request["streams"]):
        seed, size = request["seed"] + index, request["group_size"]
        n = request["n_samples"]
        parts = evenly(n, size, size + 1, entry_point.n_strata)
        planted = plant(entry_point.problem, n, size, 1, size + 1, seed, strata=parts)
        outcome = Stream(entry_point, planted, seed).run(request["trials"], LARGEST_CONFIDENCE)
        # One of the smaller group may lie on the larger's model, too.
        found += outcome.inliers is not None and int(outcome.inliers.sum()) > size
    return {"found": found, "runs": request["streams"]}


def trials(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count the trials of runs on one group and nothing else, which any rule ends at once.

    Parameters
    ----------
    entry_point : EntryPoint
        A function whose trials are counted.
    request : dict
        ``n_samples``, ``budget``, ``u`` (a list: one run each) and ``seed``.

    Returns
    -------
    dict
        ``trials``, one a run, and ``runs``.
    """
    n = request["n_samples"]
    stream = Stream(
        entry_point, plant(entry_point.problem, n, n, 1, 0, request["seed"]), request["seed"]
    )
    counts = [stream.run(request["budget"], confidence_of(u)).trials for u in request["u"]]
    return {"trials": counts, "runs": stream.runs}


def defaults(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Compare runs with nothing set with runs of a stated number of trials.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``n_samples``, ``group_size``, ``n_groups``, ``strata`` (of `plant`), ``trials``
        (expected at the defaults), ``streams``, ``seconds`` (no further stream is begun after),
        ``seed``, and ``tolerance``: by how much a count of trials may differ.

    Returns
    -------
    dict
        ``same`` and ``different`` (streams on which the outcomes agree, or the reported trials
        are those expected), ``found`` (streams on which B was found), and ``runs``.
    """
    same = different = found = runs = 0
    started = time.monotonic()
    for index in range(request["streams"]):
        if time.monotonic() - started > request["seconds"]:
            break
        seed = request["seed"] + index
        size = request["group_size"]
        # B's count may end a run before the cap does, which shows in a count of trials.
        larger = 0 if entry_point.counted else size + 1
        planted = plant(
            entry_point.problem,
            request["n_samples"],
            size,
            request["n_groups"],
            larger,
            seed,
            strata=[(n, a, b if larger else 0) for n, a, b in request["strata"]],
        )
        stream = Stream(entry_point, planted, seed)
        outcome = stream.run_at_defaults()
        runs += 1
        group = planted.group_of(outcome.inliers)
        hit = group == stream.label_b
        if group is None and outcome.inliers is not None and outcome.inliers.sum() >= size:
            # A chance model governs the rule.
            continue
        if outcome.trials is not None:
            agree = abs(outcome.trials - request["trials"]) <= request["tolerance"]
        else:
            agree = hit == stream.finds_b(request["trials"], LARGEST_CONFIDENCE)
            runs += 1
        same += agree
        different += not agree
        found += hit
    return {"same": same, "different": different, "found": found, "runs": runs}

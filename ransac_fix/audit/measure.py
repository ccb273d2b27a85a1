"""Measure one entry point: ask for draws and points until the laws are known."""

from dataclasses import dataclass, replace
from typing import Any

from ransac_fix.audit import laws, outcomes, plan, sampling
from ransac_fix.audit.asking import Asked, Looks
from ransac_fix.audit.dispersion import goes_by_the_data
from ransac_fix.audit.model import Defect, OutcomeEvidence, Point, SamplerLaw
from ransac_fix.audit.worker import streams
from ransac_fix.audit.worker.planted import PROBLEMS
from ransac_fix.criterion import all_inlier_probability

# Runs that look at the sampler: at a time, and at most.
_HELPING = 20
_MOST_LOOKS = 2_560
_LOOKS_IN_VAIN = 640
_FEWEST_POINTS = 4
_ENOUGH_POINTS = 6
_STREAMS = 40
SEED = 20_250_000

_FILTER_RUNS = 60

# Runs that look for a defect.
_LOOKS = 40
# Measurements on which P^k of a minimal sample leaves the range of a careless program, a share
# of inliers that one sample in twenty meets, trials enough to meet it, and runs.
_MANY = 1500
_SELDOM = 0.05
_MANY_TRIALS = 120
_MANY_RUNS = 3
# Measurements and inliers of a problem of a few trials, and an eighth of the budget for it.
_EASY = (20, 18, 60)
# Large groups, of nearly one size: a rule that ends a run at a confidence of its own misses the
# larger now and then.
_LARGE = (45, 22)
# Of a confidence of 0.99 one run in 180 does: none of so many do once in 10^7 times.
_LARGE_RUNS = 3000
_LARGE_STEP = 100
# A rule that sees inliers only ends a run at once, whatever -ln(1-s).
_BUDGET = 60
_CONFIDENCES = [0.1, 1.0, 5.0, 20.0]
# Inliers beyond a sample and measurements besides of a smaller group that is found soon and before
# the larger in two runs of five. A rule with a confidence of its own, 0.95, would end six runs of
# six just when it is found once in 10^7 times.
_SOON = 12
_ENDINGS = 6
_MOST_ENDINGS = 60
_ENDING_SECONDS = 20.0
_ENDED_EARLY = {streams.TOO_SHORT, streams.FIXED_COUNT}
# Why a function that takes no number of trials cannot be measured.
_LIMITED = (
    "takes no number of trials, and ends runs by a limit of its own on problems of a few hundred"
)
# Trials that a healthy rule may take for one of them.
_LONGEST_ENDING = 600


@dataclass(frozen=True, slots=True)
class Measurement:
    """The evidence on one entry point.

    Parameters
    ----------
    sampler : SamplerLaw
        How samples are drawn.
    points : tuple of Point
        Of the stopping rule.
    fit : Fit
        What the points say.
    runs : int
        Library runs spent.
    discarded : dict
        Why streams were thrown away, and how many.
    defects : tuple of str
        What the program does besides its law, or in place of one.
    outcomes : OutcomeEvidence or None
        The evidence in place of points, where runs can be neither repeated nor counted.
    unmeasured : str
        Why the rule cannot be measured; empty where it can.
    """

    sampler: SamplerLaw
    points: tuple[Point, ...]
    fit: laws.Fit
    runs: int
    discarded: dict[str, int]
    defects: tuple[Defect, ...] = ()
    outcomes: OutcomeEvidence | None = None
    unmeasured: str = ""


def measure(
    host: Asked, one: dict[str, Any], seed: int = SEED, *, verdict_only: bool = False
) -> Measurement:
    """Measure the sampler and the stopping rule of one entry point.

    Parameters
    ----------
    host : Asked
        Runs the library.
    one : dict
        The entry point as described by the worker.
    seed : int, optional
        Fixes the planted problems and the random streams.
    verdict_only : bool, default False
        Whether runs whose outcomes alone are seen need not tell laws of one verdict apart.

    Returns
    -------
    Measurement
    """
    sampler, runs = sampler_law(host, one, seed, once=not one["budget"])
    sampler, more = _with_filter(host, one, sampler, seed)
    runs += more
    if goes_by_outcomes(one):
        return _by_outcomes(host, one, sampler, runs, seed, verdict_only)
    points: list[Point] = []
    discarded: dict[str, int] = {}
    fit = laws.Fit(None)
    k = one["sample_size"]
    for attempt in range(2):
        for kind, setting, wanted in _steps(one, sampler, counting=attempt == 0):
            answer = host.ask(
                "points",
                entry_point=one["name"],
                **_request(setting, kind, wanted, seed + 1000 * attempt),
            )
            runs += answer["runs"]
            for why, times in answer["discarded"].items():
                discarded[why] = discarded.get(why, 0) + times
            points += [_point(raw, k) for raw in answer["points"]]
            if kind == "count" and set(answer["discarded"]) == {streams.BUDGET_REACHED}:
                never_ends, more = _never_ends(host, one["name"], seed)
                runs += more
                if never_ends:
                    return Measurement(sampler, (), fit, runs, discarded, ("no rule",))
            if 2 * answer["discarded"].get(streams.BUDGET_REACHED, 0) > sum(
                answer["discarded"].values(), len(answer["points"])
            ):
                # A rule that is tested on improvement only lets no run end on A's count.
                break
            if answer["discarded"].keys() <= _ENDED_EARLY and not points:
                at_once, more = _ends_at_once(host, one, sampler, seed)
                runs += more
                if at_once:
                    return Measurement(sampler, (), fit, runs, discarded, ("first consensus",))
        fit = laws.fit(points, one["sample_size"])
        if fit.law is not None or (not fit.rivals and len(points) >= _ENOUGH_POINTS):
            break
    if fit.law is not None:
        points = [replace(point, sample_size=fit.law.sample_size) for point in points]
    defects, more = _defects(host, one, sampler, points, discarded, seed)
    runs += more
    if "first model" in defects:
        # More than one trial was never had.
        once, more = sampler_law(host, one, seed, once=True)
        runs += more
        if once.drawn in ("distinct", "replacement", "stratified", "weighted"):
            sampler = once
            # Points of the few streams that began with a larger model do not make a law.
            fit = laws.Fit(None)
        else:
            # First samples that depend on the order are the reason, as with PROSAC.
            defects = ()
    return Measurement(sampler, tuple(points), fit, runs, discarded, defects)


def goes_by_outcomes(one: dict[str, Any]) -> bool:
    """Whether nothing shows the rule of an entry point but what many runs return.

    Parameters
    ----------
    one : dict
        The entry point as described by the worker.
    """
    return not one["budget"] or not (one["repeatable"] or one["counted"])


def settings_for(
    one: dict[str, Any], sampler: SamplerLaw, *, counted: bool
) -> tuple[plan.Setting, ...]:
    """Return the planted problems that suit an entry point and its sampler.

    Parameters
    ----------
    one : dict
        The entry point as described by the worker.
    sampler : SamplerLaw
        How it draws.
    counted : bool
        Whether trials are counted.
    """
    typical, spare = one["typical_trials"], one["spare"]
    if one["n_strata"] > 1:
        return plan.strata_settings(
            sampling.drawing_of(sampler), one["n_strata"], typical, spare=spare, counted=counted
        )
    make = plan.counted_settings if counted else plan.settings
    return make(one["sample_size"], typical, spare=spare, fewest=one["fewest_samples"])


def _by_outcomes(
    host: Asked,
    one: dict[str, Any],
    sampler: SamplerLaw,
    runs: int,
    seed: int,
    verdict_only: bool,
) -> Measurement:
    """Measure a rule that shows in nothing but how often runs return which model."""
    unmeasured = _not_by_outcomes(one, sampler)
    if unmeasured:
        return Measurement(sampler, (), laws.Fit(None), runs, {}, unmeasured=unmeasured)
    if not one["budget"]:
        limited, more = outcomes.is_limited(host, one, sampler, seed + 50_000)
        runs += more
        if limited:
            return Measurement(sampler, (), laws.Fit(None), runs, {}, unmeasured=_LIMITED)
    if not one["repeatable"]:
        by_the_data, more = goes_by_the_data(host, one, sampler, seed + 50_000)
        runs += more
        if by_the_data:
            return Measurement(sampler, (), laws.Fit(None), runs, {}, ("beyond counts",))
    decision = outcomes.decide(host, one, sampler, seed + 30_000, verdict_only=verdict_only)
    defects: tuple[Defect, ...] = () if decision.defect is None else (decision.defect,)
    return Measurement(
        sampler, (), decision.fit, runs + decision.runs, {}, defects, decision.evidence
    )


def _not_by_outcomes(one: dict[str, Any], sampler: SamplerLaw) -> str:
    """Say why outcomes cannot show the rule; empty where they can.

    The laws give the chance of an outcome from that of a trial, which must be known but for a
    common factor.
    """
    why = (
        "runs can be neither repeated nor counted"
        if one["budget"]
        else "it takes no number of trials"
    )
    if one["verifying"]:
        return (
            f"{why}, and outcomes do not show the rule: "
            f"{one['verifying']} of the {one['sample_size']} of a sample only choose among the "
            "models of the others, so that models come from samples with clutter, too"
        )
    if sampler.drawn == "undecided":
        return (
            f"the sampler could not be told from {sampler.runs} runs ({sampler.hits} hits, "
            f"{sampler.expected:g} expected)"
        )
    if sampler.drawn not in ("distinct", "replacement"):
        return (
            f"{why}, and outcomes show the rule of uniform samples only; these are {sampler.drawn}"
            f"{f': {sampler.strayed}' if sampler.strayed else ''}"
        )
    return ""


def _never_ends(host: Asked, name: str, seed: int) -> tuple[bool, int]:
    """Whether runs use a budget that is dozens of times what any rule would ask for."""
    setting = plan.Setting(_EASY[0], _EASY[1], 1, _EASY[2])
    answer = host.ask("points", entry_point=name, **_request(setting, "count", 4, seed))
    return set(answer["discarded"]) == {streams.BUDGET_REACHED}, answer["runs"]


def _ends_at_once(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int
) -> tuple[bool, int]:
    """Whether runs end with the first model that has more inliers than its sample."""
    if sampler.drawn not in ("distinct", "replacement"):
        return False, 0
    size = sampler.sample_size + _SOON
    n = max(one["fewest_samples"], 2 * size + 1)
    budget = round(12 / all_inlier_probability(size + 1, n, sampler.sample_size))
    if budget > _LONGEST_ENDING:
        return False, 0
    answer = host.ask(
        "endings",
        entry_point=one["name"],
        n_samples=n,
        group_size=size,
        budget=budget,
        wanted=_ENDINGS,
        streams=_MOST_ENDINGS,
        seconds=_ENDING_SECONDS,
        seed=seed + 40_000,
    )
    return answer["first"] >= _ENDINGS and not answer["later"], answer["runs"]


def _steps(
    one: dict[str, Any], sampler: SamplerLaw, *, counting: bool
) -> list[tuple[str, plan.Setting, int]]:
    """Return the kinds of point to ask for, on which problems, and how many.

    Counted trials are checked by a flip point of the shortest runs, unless the draws themselves
    were counted: then one point a problem does, as such libraries are slow. Flip points are the
    evidence else.
    """
    flips = []
    if one["repeatable"]:
        flips = [("flip", s, s.points) for s in settings_for(one, sampler, counted=False)]
    if not (one["counted"] and counting):
        return flips
    checked = sorted(flips, key=lambda step: step[1].trials)[:1]
    counts = settings_for(one, sampler, counted=True)
    if one["watched"]:
        return [("count", setting, 1) for setting in counts]
    return [
        *(("count", setting, setting.points) for setting in counts),
        *(("flip", setting, 1) for _, setting, _ in checked),
    ]


def _request(setting: plan.Setting, kind: str, wanted: int, seed: int) -> dict[str, Any]:
    return {
        "kind": kind,
        "n_samples": setting.n,
        "group_size": setting.group_size,
        "n_groups": setting.n_groups,
        "wanted": wanted,
        "streams": _STREAMS,
        "largest": 8 * setting.trials,
        "smallest": max(8, setting.trials // 4),
        "seed": seed,
        "u": [2.5, 6.0],
        "strata": setting.strata,
    }


def _point(raw: dict[str, Any], sample_size: int) -> Point:
    strata = tuple((inliers, n) for inliers, n in raw["strata"])
    return Point(
        n=raw["n_samples"],
        n_inliers=raw["n_inliers"],
        sample_size=sample_size,
        trials=raw["trials"],
        u=raw["u_high"],
        u_low=raw["u_low"],
        in_hand=raw["in_hand"],
        kind=raw["kind"],
        strata=strata if len(strata) > 1 else (),
    )


def sampler_law(
    host: Asked, one: dict[str, Any], seed: int, *, once: bool = False
) -> tuple[SamplerLaw, int]:
    """Measure how samples are drawn; return the law, and the runs that took.

    Parameters
    ----------
    host, one, seed
        As in `measure`.
    once : bool, default False
        Let runs have one trial only.
    """
    hits: list[sampling.Hit] = []
    runs = 0
    k, seeded, n_strata = (one[key] for key in ("sample_size", "seeded", "n_strata"))
    known: dict[str, Any] = {
        key: one[key] for key in ("verifying", "n_strata", "seeded", "size_seen")
    }
    limits = {"spare": one["spare"], "fewest": one["fewest_samples"], "n_strata": n_strata}
    first = plan.first_cases(k, seeded, **limits)
    pool = plan.case_pool(k, seeded, **limits)
    if once:
        first, pool = ([replace(case, trials=1) for case in some] for some in (first, pool))
    cases = first
    while True:
        answer = host.ask(
            "hits",
            entry_point=one["name"],
            cases=[[case.n, case.size, case.trials, case.first, case.strata] for case in cases],
            seed=seed + 10_000 + len(hits),
            watch=not once,
        )
        hits += [sampling.Hit(case, hit) for case, hit in zip(cases, answer["hits"], strict=True)]
        runs += answer["runs"]
        law = sampling.decide(hits, k, **known)
        most = _MOST_LOOKS if law.found >= sampling.LEAST_FOUND else _LOOKS_IN_VAIN
        if law.drawn != "undecided":
            return law, runs
        # One law is left, and the group is hit too often or too seldom for it somewhere.
        doubtful = law.error <= sampling.ERROR_RATE and law.found >= sampling.LEAST_FOUND
        if len(hits) >= most:
            return sampling.decide(hits, k, **known, last=True) if doubtful else law, runs
        if doubtful:
            cases = first
            continue
        cases = sampling.most_telling(hits, pool, k, max(_HELPING, len(hits) // 4), **known)
        if not cases:
            law = sampling.decide(hits, k, **known, last=True)
            return law, runs


def _with_filter(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int
) -> tuple[SamplerLaw, int]:
    """Look for a filter of samples on measurements that it may reject."""
    problem = f"{one['problem']}_scattered"
    uniform = sampler.drawn in ("distinct", "replacement")
    # Draws that were watched are made before there is anything to reject.
    unseen = one["watched"] or not one["budget"]
    if problem not in PROBLEMS or not uniform or unseen or one["n_strata"] > 1:
        return sampler, 0
    cases = plan.filter_cases(
        sampler.sample_size, _FILTER_RUNS, spare=one["spare"], fewest=one["fewest_samples"]
    )
    answer = host.ask(
        "hits",
        entry_point=one["name"],
        cases=[[case.n, case.size, case.trials, case.first, case.strata] for case in cases],
        problem=problem,
        seed=seed + 30_000,
    )
    hits = [sampling.Hit(case, hit) for case, hit in zip(cases, answer["hits"], strict=True)]
    return replace(sampler, accepted=sampling.accepted(hits, sampler)), answer["runs"]


def _defects(
    host: Asked,
    one: dict[str, Any],
    sampler: SamplerLaw,
    points: list[Point],
    discarded: dict[str, int],
    seed: int,
) -> tuple[tuple[Defect, ...], int]:
    """Look for what a law through the points does not show, or why there are no points."""
    k, looks = one["sample_size"], _Looks(host, one["name"], seed + 20_000)
    if one["counted"] and not points and looks.uses_all(max(one["fewest_samples"], k + 4)):
        return ("no rule",), looks.runs
    ended_early = 2 * discarded.get(streams.NOT_FOUND, 0) > sum(discarded.values(), len(points))
    if len(points) >= _FEWEST_POINTS and not ended_early:
        # Any rule but a broken one finds this group among many measurements.
        case = [_MANY, round(_MANY * _SELDOM ** (1 / k)), _MANY_TRIALS, "anything", []]
        overflows = looks.hits([case] * _MANY_RUNS) < _MANY_RUNS and (
            looks.hits([case] * 4 * _MANY_RUNS) <= 2 * _MANY_RUNS
        )
        return (("overflow",) if overflows else ()), looks.runs
    if discarded.get(streams.NEVER_STOPS, 0) >= _ENOUGH_POINTS:
        n, size = _LARGE
        trials = round(14 / all_inlier_probability(size, n, k))
        while looks.runs < _LARGE_RUNS:
            if looks.larger(n, size, trials, _LARGE_STEP) < _LARGE_STEP:
                return ("confidence ignored",), looks.runs
        return ("no rule",), looks.runs
    # How often a group is found must grow with the trials.
    n = max(one["fewest_samples"], k + 4)
    size = n - 2
    trials = round(20 / all_inlier_probability(size, n, k))
    # The same streams: a program that ends at once finds no more of them with more trials.
    at_once = looks.hits([[n, size, 1, "anything", []]] * _LOOKS)
    in_the_end = looks.hits([[n, size, trials, "anything", []]] * _LOOKS, again=True)
    ended = 0 < in_the_end < at_once + _LOOKS // 4 and at_once < _LOOKS * 3 // 4
    if ended:
        return ("first model",), looks.runs
    ended, more = _ends_at_once(host, one, sampler, seed)
    return (("first consensus",) if ended else ()), looks.runs + more


class _Looks(Looks):
    """Counts finds."""

    def hits(self, cases: list[list[Any]], *, again: bool = False) -> int:
        """Return how many runs found the one group planted, on the last streams or new ones."""
        seed = self._seed + self.runs - (len(cases) if again else 0)
        return sum(self._ask("hits", cases=cases, seed=seed)["hits"])

    def uses_all(self, n: int) -> bool:
        """Whether runs use their budget at every confidence, though all n are inliers."""
        answer = self._ask("trials", n_samples=n, budget=_BUDGET, u=_CONFIDENCES, seed=self._seed)
        return all(trials == _BUDGET for trials in answer["trials"])

    def larger(self, n: int, size: int, trials: int, runs: int) -> int:
        """Return how many runs found the larger of two groups at the highest confidence."""
        answer = self._ask(
            "larger",
            n_samples=n,
            group_size=size,
            trials=trials,
            streams=runs,
            seed=self._seed + self.runs,
        )
        return int(answer["found"])

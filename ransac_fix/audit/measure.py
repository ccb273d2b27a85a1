"""Measure one entry point: ask for draws and points until the laws are known."""

from dataclasses import dataclass, replace
from typing import Any, Protocol

from ransac_fix.audit import laws, plan, sampling
from ransac_fix.audit.model import Point, SamplerLaw

# Runs that look at the sampler: at first, and at most. They double until they suffice.
_FIRST_HELPING = 40
_MOST_LOOKS = 2_560
_ENOUGH_POINTS = 6
_STREAMS = 40
SEED = 20_250_000


class Asked(Protocol):
    """Whoever runs the library: a worker process, or this one."""

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        """Answer one request; see `ransac_fix.audit.worker.streams`."""


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
    """

    sampler: SamplerLaw
    points: tuple[Point, ...]
    fit: laws.Fit
    runs: int
    discarded: dict[str, int]


def measure(host: Asked, one: dict[str, Any], seed: int = SEED) -> Measurement:
    """Measure the sampler and the stopping rule of one entry point.

    Parameters
    ----------
    host : Asked
        Runs the library.
    one : dict
        The entry point as described by the worker.
    seed : int, optional
        Fixes the planted problems and the random streams.

    Returns
    -------
    Measurement
    """
    sampler, runs = _sampler_law(host, one, seed)
    points: list[Point] = []
    discarded: dict[str, int] = {}
    fit = laws.Fit(None)
    k, typical = one["sample_size"], one["typical_trials"]
    limits = {"spare": one["spare"], "fewest": one["fewest_samples"]}
    for attempt in range(2):
        # Counted trials are checked by a flip point; flip points are the evidence else.
        steps = [("flip", s, s.points) for s in plan.settings(k, typical, **limits)]
        if not one["repeatable"]:
            steps = []
        if one["counted"] and attempt == 0:
            checked = steps[:1]
            steps = [("count", s, s.points) for s in plan.counted_settings(k, typical, **limits)]
            steps += [("flip", setting, 1) for _, setting, _ in checked]
        for kind, setting, wanted in steps:
            answer = host.ask(
                "points",
                entry_point=one["name"],
                **_request(setting, kind, wanted, seed + 1000 * attempt),
            )
            runs += answer["runs"]
            for why, times in answer["discarded"].items():
                discarded[why] = discarded.get(why, 0) + times
            points += [_point(raw, k) for raw in answer["points"]]
        fit = laws.fit(points, one["sample_size"])
        if fit.law is not None or (not fit.rivals and len(points) >= _ENOUGH_POINTS):
            break
    if fit.law is not None:
        points = [replace(point, sample_size=fit.law.sample_size) for point in points]
    return Measurement(sampler, tuple(points), fit, runs, discarded)


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
    }


def _point(raw: dict[str, Any], sample_size: int) -> Point:
    return Point(
        n=raw["n_samples"],
        n_inliers=raw["n_inliers"],
        sample_size=sample_size,
        trials=raw["trials"],
        u=raw["u_high"],
        u_low=raw["u_low"],
        in_hand=raw["in_hand"],
        kind=raw["kind"],
    )


def _sampler_law(host: Asked, one: dict[str, Any], seed: int) -> tuple[SamplerLaw, int]:
    hits: list[sampling.Hit] = []
    k = one["sample_size"]
    looks = _FIRST_HELPING
    while True:
        cases = plan.hit_cases(
            k, one["seeded"], looks, spare=one["spare"], fewest=one["fewest_samples"]
        )[len(hits) :]
        answer = host.ask(
            "hits",
            entry_point=one["name"],
            cases=[[case.n, case.size, case.trials, case.first] for case in cases],
            seed=seed + 10_000 + len(hits),
        )
        hits += [
            sampling.Hit(case, raw[-1]) for case, raw in zip(cases, answer["hits"], strict=True)
        ]
        law = sampling.decide(hits, k, one["verifying"])
        if law.drawn != "undecided" or looks >= _MOST_LOOKS:
            return law, looks
        looks *= 2

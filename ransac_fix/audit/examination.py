"""One entry point, from the worker's description of it to its verdict."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ransac_fix.audit.asking import Asked
from ransac_fix.audit.defaults import at_defaults, rule_trials, standard_problems
from ransac_fix.audit.drawing import spread
from ransac_fix.audit.extended import count_trials, decide_by_outcomes, judge_extension
from ransac_fix.audit.judge import advise, judge
from ransac_fix.audit.measure import (
    SEED,
    Measurement,
    goes_by_outcomes,
    measure,
    sampler_law,
    settings_for,
)
from ransac_fix.audit.model import AtDefaults, Verdict
from ransac_fix.systems import load_systems
from ransac_fix.verdicts import fixed_release

# A default cap up to this many trials is checked by running into it.
_CHECKED_TRIALS = 5_000
_CHECK_STREAMS = 12
_COUNTED_STREAMS = 3
_LARGEST_CHECK = 60
_CHECK_SECONDS = 1.0


def examine(
    host: Asked,
    system: str,
    version: str | None,
    one: dict[str, Any],
    problems: Sequence[tuple[int, int, float | None]] = (),
    *,
    wrapped: bool = False,
    quick: bool = False,
) -> Verdict:
    """Measure one entry point and judge it.

    Parameters
    ----------
    host : Asked
        Runs the library.
    system : str
        Its name.
    version : str or None
        Its version; None where it has none.
    one : dict
        The entry point as described by the worker.
    problems : sequence of (n, I, s), optional
        Where to state guarantees besides the standard problems; s None for the default.
    wrapped : bool, default False
        Whether a patch wraps the library, so that what it adds is counted.
    quick : bool, default False
        Whether runs that show nothing but outcomes end once the verdict is settled.

    Returns
    -------
    Verdict

    Raises
    ------
    WorkerFailed
        If the library raised, crashed or hung.
    """
    started = time.monotonic()
    found: Verdict | None = None
    if wrapped:
        found = _extended(host, system, version, one)
    if found is None:
        found = _measured(host, system, version, one, problems, quick)
    return replace(found, seconds=round(time.monotonic() - started, 3))


def _extended(host: Asked, system: str, version: str | None, one: dict[str, Any]) -> Verdict | None:
    """Judge a wrapped function by its trials and outcomes; None where calls are passed through."""
    name = one["name"]
    if not one["budget"]:
        why = "it takes no number of trials, so that those that it leaves out cannot be counted"
        return Verdict(system, name, version, "not measured", why)
    sampler, runs = sampler_law(host, one, SEED)
    counts, more = count_trials(host, one, sampler, SEED + 7000)
    if not counts:
        return None
    outcomes, again = decide_by_outcomes(host, one, sampler, SEED + 9000)
    verdict, reason, extension = judge_extension(counts, sampler, outcomes, counted=one["counted"])
    return Verdict(
        system,
        name,
        version,
        verdict,
        reason,
        sampler_law=sampler,
        runs=runs + more + again,
        extension=extension,
    )


def _measured(
    host: Asked,
    system: str,
    version: str | None,
    one: dict[str, Any],
    problems: Sequence[tuple[int, int, float | None]],
    quick: bool,
) -> Verdict:
    """Judge a function by the laws of its sampler and its rule."""
    measured = measure(host, one, verdict_only=quick)
    verdict, reason = judge(measured)
    runs, advice = measured.runs, ""
    defaults: AtDefaults | None = None
    declared = one["defaults"]
    if declared is not None and (measured.points or measured.outcomes or measured.defects):
        checked = None
        if not goes_by_outcomes(one):
            checked, more = _check_defaults(host, one, declared, measured)
            runs += more
        standard = standard_problems(measured.sampler.sample_size)
        defaults = at_defaults(
            declared,
            measured.fit.law,
            measured.sampler,
            [*((n, n_inliers, None) for n, n_inliers in standard), *problems],
            checked,
            one["n_strata"],
        )
        fixed_in = fixed_in_release(system, version, one["name"])
        advice = advise(verdict, defaults, declared["max_trials_name"], fixed_in)
    return Verdict(
        system,
        one["name"],
        version,
        verdict,
        reason,
        advice,
        measured.sampler,
        measured.fit.law,
        defaults,
        measured.points,
        measured.defects,
        measured.outcomes,
        runs,
    )


def fixed_in_release(system: str, version: str | None, entry_point: str) -> str | None:
    """Return the first newer release that was measured not to undersample any more.

    Parameters
    ----------
    system, version, entry_point : str
        What is in use; the version of a library that is no release is None.

    Returns
    -------
    str or None
        None where there is none, or none was measured.
    """
    known = next((one for one in load_systems() if one.name == system), None)
    if version is None or known is None or not known.distributions:
        return None
    return fixed_release(known.distributions[0], version, entry_point)


def _check_counts(
    host: Asked, one: dict[str, Any], declared: dict[str, Any], measured: Measurement
) -> tuple[bool | None, int]:
    """Count the trials of runs with nothing set where the minimum binds, and the rule."""
    law, k, n_strata = measured.fit.law, one["sample_size"], one["n_strata"]
    assert law is not None
    fewest, multiplier = declared["min_trials"], declared["multiplier"]
    expected: dict[tuple[int, int], int] = {}
    for n in range(max(2 * k + 6, one["fewest_samples"]), _LARGEST_CHECK):
        for size in range(k + 2, n - 1):
            strata = spread(size, n, n_strata)
            trials = math.ceil(multiplier * rule_trials(law, strata, declared["confidence"]))
            if 2 * trials < fewest:
                expected[n, size] = fewest
            elif 1.3 * fewest < trials < 2 * fewest:
                expected[n, size] = trials
    runs = same = different = 0
    for binds in (True, False):
        chosen = [key for key, trials in expected.items() if (trials == fewest) == binds]
        if not chosen:
            return None, runs
        n, size = chosen[0]
        answer = host.ask(
            "defaults",
            entry_point=one["name"],
            n_samples=n,
            group_size=size,
            n_groups=1,
            strata=[(total, inliers, 0) for inliers, total in spread(size, n, n_strata)],
            trials=expected[n, size],
            # Whether the offset is multiplied, too, is not known.
            tolerance=2 * (1 + multiplier),
            streams=_COUNTED_STREAMS,
            seconds=_CHECK_SECONDS,
            seed=SEED + 5000,
        )
        runs += answer["runs"]
        same, different = same + answer["same"], different + answer["different"]
    return (different == 0 if same + different else None), runs


def _check_defaults(
    host: Asked, one: dict[str, Any], declared: dict[str, Any], measured: Measurement
) -> tuple[bool | None, int]:
    """Run with nothing set where the default cap binds, and see whether it does."""
    law, cap = measured.fit.law, declared["max_trials"]
    if law is None:
        return None, 0
    if one["counted"] and not one["watched"] and declared["min_trials"]:
        return _check_counts(host, one, declared, measured)
    if cap is None or cap > _CHECKED_TRIALS:
        return None, 0
    # B comes after about as many trials as the cap allows; the rule would allow far more.
    setting = settings_for({**one, "typical_trials": cap / 2}, measured.sampler, counted=False)[0]
    strata = tuple((a, n) for n, a, _ in setting.strata) or ((setting.group_size, setting.n),)
    rule = rule_trials(law, strata, declared["confidence"])
    if rule * declared["multiplier"] < 1.5 * cap:
        return None, 0
    answer = host.ask(
        "defaults",
        entry_point=one["name"],
        n_samples=setting.n,
        group_size=setting.group_size,
        n_groups=1,
        strata=setting.strata,
        trials=cap,
        tolerance=0,
        streams=_CHECK_STREAMS,
        seconds=_CHECK_SECONDS,
        seed=SEED + 5000,
    )
    if not answer["same"] + answer["different"]:
        return None, answer["runs"]
    return answer["different"] == 0, answer["runs"]

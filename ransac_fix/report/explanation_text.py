"""An explanation as text for the terminal."""

from collections.abc import Sequence

from ransac_fix.experiments.explanation import Explanation, LawOutcome, LimitedRun
from ransac_fix.report.text_table import count_text, percent_text, probability_text, text_table

_LAW_NAMES = {
    "distinct": "distinct",
    "replacement": "with replacement",
    "stratified": "stratified",
}

# What the numbers mean, wherever a probability is shown.
PROMISE = """\
What N promises: once a model with I inliers is in hand, N trials contain at least one
all-inlier sample of any other set of I inliers with probability s. It is a guarantee about
what may still be missed, not the success rate of a whole run."""


# Where the numbers of the last two columns come from.
ROUNDING = """\
N is rounded up; the last two columns take it as it is before, as the paper does."""


def explanation_text(explanation: Explanation) -> str:
    """Return the whole explanation: both rules, each sampling law, limits, enumeration."""
    parts = [_question(explanation), f"{_laws(explanation)}\n{ROUNDING}", _verdict(explanation)]
    if explanation.problem.has_limits:
        parts.append(_limits(explanation))
    parts += [_enumeration(explanation), PROMISE]
    return "\n\n".join(parts)


def sweep_text(rows: Sequence[Explanation], sampling: str) -> str:
    """Return a table with one line a row of the sweep, under one sampling law."""
    limited = rows[0].problem.has_limits
    header = ["n", "I", "I/n", "N_a", "N_e", "undersampled", "true success", "subsets"]
    if limited:
        header += ["N_a run", "guarantee", "N_e run", "guarantee"]
    cells = []
    for row in rows:
        law, problem = row.law(sampling), row.problem
        line = [
            f"{problem.n_samples:,}",
            f"{problem.n_inliers:,}",
            f"{problem.n_inliers / problem.n_samples:.4g}",
            count_text(row.approximate_trials),
            count_text(law.required_trials),
            *reversed(_shortfall(row, law)),
            count_text(law.n_subsets),
        ]
        for run in (law.approximate_within_limits, law.exact_within_limits):
            if run is not None:
                line += [count_text(run.trials), probability_text(run.guarantee)]
        cells.append(line)
    title = f"Sampling: {_LAW_NAMES[sampling]}. N_a: trials of the p^k rule, N_e: of the exact one."
    return title + "\n" + text_table(header, cells, left=0)


def _question(explanation: Explanation) -> str:
    problem = explanation.problem
    line = (
        f"n = {problem.n_samples:,} measurements, I = {problem.n_inliers:,} inliers"
        f" (p = {problem.n_inliers / problem.n_samples:.4g}), k = {problem.sample_size} in a"
        f" sample, confidence s = {float(problem.confidence):g}"
    )
    if problem.strata:
        drawn = ", ".join(
            f"{s.sample_size} of {s.n_samples:,} ({s.n_inliers:,} inliers)" for s in problem.strata
        )
        line += f"\nstrata: {drawn}"
    return line


def _laws(explanation: Explanation) -> str:
    rows = [
        [
            "p^k, the common rule",
            f"{explanation.approximate_probability:.4g}",
            count_text(explanation.approximate_trials),
            f"{float(explanation.problem.confidence):g} assumed",
            "",
        ]
    ]
    rows += [
        [
            f"exact, {_LAW_NAMES[law.sampling]}",
            f"{law.all_inlier_probability:.4g}",
            count_text(law.required_trials),
            *_shortfall(explanation, law),
        ]
        for law in explanation.laws
    ]
    header = [
        "rule, how samples are drawn",
        "P(all-inlier)",
        "trials N",
        "true success\nof p^k rule",
        "trials missing\n(N_e - N_a)/N_a",
    ]
    return text_table(header, rows)


def _shortfall(explanation: Explanation, law: LawOutcome) -> tuple[str, str]:
    """Return the true success of the p^k rule and the trials missing.

    Both come from real-valued trials, as in the paper. With inliers only these are 0 for the
    p^k rule, which says nothing of the one trial it runs: there the whole numbers are shown.
    """
    if explanation.approximate_probability < 1 or explanation.approximate_trials != 1:
        return probability_text(law.true_success), percent_text(law.undersampling, signed=True)
    exact = law.required_trials
    missing = None if exact is None else float(exact - 1)
    return (
        probability_text(law.success_of_approximate_trials),
        percent_text(missing, signed=True),
    )


def _verdict(explanation: Explanation) -> str:
    law = explanation.laws[-1] if explanation.problem.strata else explanation.law("distinct")
    drawn = _LAW_NAMES[law.sampling]
    trials = explanation.approximate_trials
    if law.n_all_inlier_subsets == 0:
        return f"No all-inlier sample exists ({drawn}): no number of trials is enough."
    if explanation.problem.confidence == 1 and trials is None:
        return "No number of random trials is certain: at s = 1 neither rule ever stops."
    if law.required_trials == trials:
        return f"Samples drawn {drawn}: both rules run the same trials here."
    return (
        f"Samples drawn {drawn}: the p^k rule runs {count_text(trials)} trials, which hold an"
        f" all-inlier\nsample with probability"
        f" {probability_text(law.success_of_approximate_trials)}; {count_text(law.required_trials)}"
        f" are needed for {float(explanation.problem.confidence):g}."
    )


def _limits(explanation: Explanation) -> str:
    problem = explanation.problem
    said = []
    if problem.min_trials:
        said.append(f"at least {problem.min_trials:,}")
    if problem.max_trials is not None:
        said.append(f"at most {problem.max_trials:,}")
    rows = []
    for law in explanation.laws:
        approximate, exact = law.approximate_within_limits, law.exact_within_limits
        assert approximate is not None
        assert exact is not None
        rows.append([_LAW_NAMES[law.sampling], *_run(approximate), *_run(exact)])
    header = [
        "samples drawn",
        "p^k rule\nruns",
        "\nbound by",
        "\nguarantee",
        "exact rule\nruns",
        "\nbound by",
        "\nguarantee",
    ]
    title = f"With {' and '.join(said)} trials:"
    return "\n".join(
        [title, text_table(header, rows), *_limits_advice(explanation.law("distinct"))]
    )


def _run(run: LimitedRun) -> list[str]:
    return [count_text(run.trials), run.bound_by, probability_text(run.guarantee)]


def _limits_advice(law: LawOutcome) -> list[str]:
    approximate, exact = law.approximate_within_limits, law.exact_within_limits
    assert approximate is not None
    assert exact is not None
    if approximate.bound_by == exact.bound_by != "rule":
        limit = {"minimum": "floor", "maximum": "cap"}[exact.bound_by]
        return [f"The {limit} decides under both rules: mending the rule alone changes nothing."]
    if exact.bound_by == "maximum":
        return ["The cap ends the exact rule early: raise it to get the confidence asked for."]
    if approximate.bound_by == "minimum":
        return ["The floor hides part of the error of the p^k rule."]
    return []


def _enumeration(explanation: Explanation) -> str:
    lines = []
    distinct = explanation.law("distinct")
    for law in explanation.laws:
        if law.sampling == "replacement":  # the same sets as with distinct draws
            if law.enumeration_is_cheaper != distinct.enumeration_is_cheaper:
                lines.append(
                    f"With replacement {count_text(law.required_trials)} trials are needed:"
                    " trying each once is cheaper."
                )
            continue
        lines.append(
            f"{count_text(law.n_subsets)} subsets"
            f"{' of that division' if law.sampling == 'stratified' else ''} exist,"
            f" {count_text(law.n_all_inlier_subsets)} of them all-inlier: "
            + _enumeration_advice(law, explanation.approximate_trials)
        )
    return "\n".join(lines)


def _enumeration_advice(law: LawOutcome, approximate_trials: int | None) -> str:
    if law.n_all_inlier_subsets == 0:
        return "trying each once would show it for certain."
    if law.required_trials is None:
        return "trying each once is certain,\nwhich no number of random trials is."
    if not law.enumeration_is_cheaper:
        return "sampling is cheaper than trying each once."
    advice = (
        f"trying each once is certain and takes no more\ntrials than the exact rule"
        f" ({count_text(law.required_trials)})"
    )
    if approximate_trials is None or law.n_subsets <= approximate_trials:
        advice += f", nor than the p^k rule ({count_text(approximate_trials)})"
    return advice + ": enumerate."

"""How often the test by outcomes mistakes a law: simulated audits of laws that are known.

    python benchmarks/outcome_error_rates.py --audits 400 --jobs 2

A run is simulated trial by trial: when a planted group is hit first, which, and whether the rule
let the larger one be hit after it. Laws, sample sizes, roundings and shares of samples found are
drawn anew in each audit. Prints every mistake, how many audits left several laws standing, and how
many runs they took. `control_zoo.py --outcomes` runs the reference in place of the simulation.
"""

import argparse
import math
import time
from collections import Counter
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from ransac_fix.audit.model import SamplerLaw
from ransac_fix.audit.outcome_laws import Hypothesis, hypotheses
from ransac_fix.audit.outcomes import decide
from ransac_fix.criterion import all_inlier_probability


class Simulated:
    """Answers for a library with this law.

    Parameters
    ----------
    law : Hypothesis
        Its rule.
    sampler : SamplerLaw
        How it draws.
    phi : float
        Shift of its rounding.
    found : float
        Share of the samples in a group from which it finds it.
    seed : int
        Fixes its draws.
    """

    def __init__(
        self, law: Hypothesis, sampler: SamplerLaw, phi: float, found: float, seed: int
    ) -> None:
        self._law = law
        self._sampler = sampler
        self._phi = phi
        self._found = found
        self._rng = np.random.default_rng(seed)

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        """Answer a request for outcomes."""
        assert do == "outcomes"
        counts = [self._counts(*case) for case in request["cases"]]
        return {"counts": counts, "runs": sum(case[-1] for case in request["cases"])}

    def _counts(
        self, n: int, size: int, groups: int, budget: int, confidence: float, runs: int
    ) -> list[int]:
        k, drawn = self._sampler.sample_size, self._sampler.drawn
        a = self._found * groups * all_inlier_probability(size, n, k, sampling=drawn)
        b = self._found * all_inlier_probability(size + 1, n, k, sampling=drawn)
        in_hand = without = budget
        # The highest confidence stands for a run that only its budget ends.
        if confidence < 1 - 2.0**-52:
            u = -math.log1p(-confidence)
            in_hand = self._trials(size, n, u, budget)
            without = max(in_hand, self._trials(k, n, u, budget))
        improving = self._law.tested == "on improvement"
        first = self._rng.geometric(min(1.0, a + b), runs)
        seen = first <= (budget if improving else without)
        smaller = self._rng.random(runs) < a / (a + b)
        end = np.maximum(first, in_hand)
        if improving:
            end = np.where(first >= in_hand, first, budget)
        kept = smaller & (first + self._rng.geometric(b, runs) > end) & seen
        return [int((seen & ~kept).sum()), int(kept.sum()), int((~seen).sum())]

    def _trials(self, n_inliers: int, n: int, u: float, budget: int) -> int:
        x = self._law.x(n_inliers, n, u)
        return budget if x >= budget else max(1, math.floor(x + self._phi))


def audit(number: int, seed: int) -> tuple[str, str, str, int]:
    """Measure one law: its name, what became of it, what was found, runs."""
    rng = np.random.default_rng([seed, number])
    k = (2, 3, 4, 5, 7)[number % 5]
    drawn = "replacement" if number % 7 == 0 else "distinct"
    laws = hypotheses(k, drawn)
    law = laws[int(rng.integers(len(laws)))]
    sampler = SamplerLaw(drawn, k, 0, 0.0, 0, (1.0, 1.0))
    phi, found = float(rng.choice([0, 0.5, 1, 1.5, 2, 3])), float(rng.uniform(0.6, 1.1))
    host = Simulated(law, sampler, phi, found, number + seed)
    one = {
        "name": "simulated",
        "sample_size": k,
        "typical_trials": 80,
        "spare": 2 if k > 4 else 1,
        "fewest_samples": 0,
    }
    decision = decide(host, one, sampler, 0)
    standing = [one for one in (decision.fit.law, *decision.fit.rivals) if one is not None]
    text = " or ".join(one.formula for one in standing) or f"{decision.defect}"
    name = f"{law.formula} ({drawn}, phi {phi:g}, found {found:.2f})"
    right = law.law in standing if law.law is not None else decision.defect == law.defect
    if right:
        return name, "found" if len(standing) < 2 else "one of several", text, decision.runs
    # Standing beside defects, or all of them: no claim is made.
    undecided = decision.fit.law is None and decision.defect is None
    if undecided and decision.evidence.no_law < math.log(1e6):
        return name, "undecided", text, decision.runs
    return name, "mistaken", text, decision.runs


def main() -> None:
    """Run the audits and print what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--audits", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    started = time.monotonic()
    results = Parallel(n_jobs=options.jobs)(
        delayed(audit)(number, options.seed) for number in range(options.audits)
    )
    for name, became, text, _ in results:
        if became == "mistaken":
            print(f"mistaken: {name}: {text}")
    became = Counter(result[1] for result in results)
    runs = sorted(result[-1] for result in results)
    print(
        ", ".join(f"{count} {what}" for what, count in became.most_common()),
        f"of {len(results)} audits; runs each: median {runs[len(runs) // 2]:,}, at most "
        f"{runs[-1]:,}; {time.monotonic() - started:.0f} s",
    )


if __name__ == "__main__":
    main()

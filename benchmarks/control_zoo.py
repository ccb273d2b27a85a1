"""How often the audit mistakes a known law: seeded audits of the whole zoo.

    python benchmarks/control_zoo.py --audits 1000 --jobs 2
    python benchmarks/control_zoo.py --outcomes --audits 200 --jobs 2
    python benchmarks/control_zoo.py --outcomes --quick --audits 200 --jobs 2

``--first 500`` goes on at audit 500 of the same series.

Each audit measures one law on planted problems and random streams of its own; the laws take
turns. Prints every mistake and, at the end, the number of them for each law. With `--outcomes`
nothing but the outcomes of runs is seen that cannot be repeated; there an audit that names no law
because several stand is counted apart. `--quick` ends these once the verdict is settled, as
`ransac-fix audit --quick` does.
"""

import argparse
import time
from collections import Counter

from joblib import Parallel, delayed

from ransac_fix.audit.control_probe import entry_point
from ransac_fix.audit.controls import OUTCOME_ZOO, ZOO
from ransac_fix.audit.judge import judge
from ransac_fix.audit.local import LocalHost
from ransac_fix.audit.measure import measure


def audit(number: int, seed: int, outcomes: bool, quick: bool) -> tuple[str, bool | None, str, int]:
    """Measure one law of the zoo; its name, whether it was recognised, what was found, runs."""
    zoo = OUTCOME_ZOO if outcomes else ZOO
    law = zoo[number % len(zoo)]
    host = LocalHost(entry_point(law))
    measured = measure(host, host.described, seed, verdict_only=quick)
    found = measured.fit.law.formula if measured.fit.law else f"none of {len(measured.points)}"
    rivals = " or ".join(rival.formula for rival in measured.fit.rivals)
    text = f"{found} {rivals}; {measured.sampler}; {measured.defects}"
    recognised: bool | None = law.recognised(measured)
    if outcomes and not recognised and judge(measured)[0] == "not measured":
        recognised = None
    return law.name, recognised, text, measured.runs


def main() -> None:
    """Run the audits and print what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--audits", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--outcomes", action="store_true")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    started = time.monotonic()
    results = Parallel(n_jobs=options.jobs)(
        delayed(audit)(number, options.seed + 100_000 * number, options.outcomes, options.quick)
        for number in range(options.first, options.audits)
    )
    wrong = Counter()
    for name, recognised, text, _ in results:
        if recognised is False:
            wrong[name] += 1
            print(f"mistaken: {name}: {text}")
    each = Counter(name for name, *_ in results)
    for law in OUTCOME_ZOO if options.outcomes else ZOO:
        print(f"{law.name:35} {wrong[law.name]:4} of {each[law.name]:4} mistaken")
    runs = sum(result[-1] for result in results)
    undecided = sum(result[1] is None for result in results)
    print(
        f"{wrong.total()} of {len(results)} audits mistaken, {undecided} undecided, {runs:,} runs, "
        f"{time.monotonic() - started:.0f} s"
    )


if __name__ == "__main__":
    main()

"""Many subsamples over the machine's cores, resumable."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import joblib
import numpy as np

from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.pose.libraries import LIBRARIES
from ransac_fix.experiments.pose.problems import Problem
from ransac_fix.experiments.pose.runs import Case, RuleRun, Settings, run_case

# Part of the stored results' keys: change it with anything that changes them.
_RESULTS_VERSION = 1


class Store:
    """Finished subsamples in a file of a folder, a line each.

    Parameters
    ----------
    folder : Path
        Made when the first is added. A line that a kill left unfinished is passed over.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "pose.jsonl"

    def load(self) -> dict[str, list[Case]]:
        """Return what is kept, by key."""
        kept = {}
        for line in self._lines():
            try:
                entry = json.loads(line)
                kept[str(entry["key"])] = [_case(**case) for case in entry["cases"]]
            except (ValueError, TypeError, KeyError):
                continue
        return kept

    def _lines(self) -> list[str]:
        try:
            return self.path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return []
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise RansacFixError(f"{self.path}: cannot be read: {why}") from None

    def add(self, key: str, cases: list[Case]) -> None:
        """Keep the cases of one subsample."""
        # The line break comes first: it ends what a kill may have left.
        line = json.dumps({"key": key, "cases": [asdict(case) for case in cases]})
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"\n{line}")
        except OSError as error:
            raise RansacFixError(f"{self.path}: cannot be written: {error.strerror}") from None

    def key(self, problem: Problem, n: int, repeat: int, settings: Settings) -> str:
        """Return what decides a subsample's results: data, settings, versions of the code.

        Those of the library, and of its patch where there is one.
        """
        data = hashlib.sha256()
        for array in (problem.first, problem.second, *problem.cameras):
            data.update(np.ascontiguousarray(array).tobytes())
        parts = (
            _RESULTS_VERSION,
            settings.library,
            LIBRARIES[settings.library].version,
            None if settings.patch is None else settings.patch.version,
            settings.confidences,
            settings.cap,
            settings.seed,
            *(problem.kind, problem.dataset, problem.name, problem.limit, data.hexdigest()),
            *(n, repeat),
        )
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def _case(approximate: dict[str, object], exact: dict[str, object], **rest: object) -> Case:
    return Case(approximate=RuleRun(**approximate), exact=RuleRun(**exact), **rest)  # type: ignore[arg-type]


def choose_pairs(problems: Sequence[Problem], n: int, seed: int) -> list[Problem]:
    """Return the problems of at most `n` pairs of each data set, chosen at random by the seed.

    A larger number keeps those of a smaller one, and all kinds of problem share their pairs.

    Parameters
    ----------
    problems : sequence of Problem
        Those there are; their order is kept.
    n : int
        Pairs of each data set, at most.
    seed : int
        Which of the choices.
    """

    def rank(pair: tuple[str, str]) -> str:
        return hashlib.sha256(f"{seed} {pair[0]} {pair[1]}".encode()).hexdigest()

    pairs: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for problem in problems:
        pairs[problem.dataset].add((problem.dataset, problem.name))
    chosen = {pair for found in pairs.values() for pair in sorted(found, key=rank)[:n]}
    return [problem for problem in problems if (problem.dataset, problem.name) in chosen]


def run_problems(
    problems: Sequence[Problem],
    settings: Settings,
    *,
    n_jobs: int = 1,
    store: Store | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,  # noqa: ARG005
) -> list[Case]:
    """Run both rules on subsamples of each problem.

    Parameters
    ----------
    problems, settings
        What is run.
    store : Store, optional
        Where finished subsamples are kept; those that are there already are not run again.
    n_jobs : int, default 1
        Workers.
    progress : callable
        Called with the subsamples done and all of them.

    Returns
    -------
    list of Case
        In the order of problems, n, repeats and confidences, whatever order they ran in.
    """
    tasks = [
        (problem, n, repeat)
        for problem in problems
        for n in settings.ns
        if len(problem.first) >= n
        for repeat in range(settings.repeats)
    ]
    results: dict[int, list[Case]] = {}
    keys = [store.key(*task, settings) for task in tasks] if store is not None else []
    if store is not None:
        kept = store.load()
        results = {i: kept[key] for i, key in enumerate(keys) if key in kept}
    progress(len(results), len(tasks))
    missing = [i for i in range(len(tasks)) if i not in results]
    parallel = joblib.Parallel(n_jobs=n_jobs, return_as="generator", batch_size=8)
    found = parallel(joblib.delayed(run_case)(*tasks[i], settings) for i in missing)
    for i, cases in zip(missing, found, strict=True):
        if store is not None:
            store.add(keys[i], cases)
        results[i] = cases
        progress(len(results), len(tasks))
    return [case for i in range(len(tasks)) for case in results[i]]

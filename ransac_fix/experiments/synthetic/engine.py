"""Many instances over many workers: joblib or a dask cluster, resumable, in any order."""

import hashlib
import os
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import joblib
import numpy as np

from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.synthetic.runs import Runs, run_instances
from ransac_fix.experiments.synthetic.setup import Setup
from ransac_fix.workers import workers

CHUNK = 500
"""Instances that one worker runs at a time."""

# Part of the stored results' name: change it with anything that changes them.
_RESULTS_VERSION = 1
# What generating and judging an instance takes, in trials of its fit.
_INSTANCE_WORK = 1000


@dataclass(frozen=True, slots=True)
class _Chunk:
    setup: Setup
    seed: int
    start: int
    stop: int

    @property
    def work(self) -> int:
        """Rough cost, for the time left: trials at the true number of inliers."""
        from ransac_fix.criterion import required_trials

        setup = self.setup
        trials = required_trials(
            setup.n_inliers, setup.n_samples, setup.sample_size, setup.confidence
        )
        return (self.stop - self.start) * (int(trials) + _INSTANCE_WORK)

    def path(self, folder: Path) -> Path:
        name = f"{_RESULTS_VERSION} {self.setup.key()} seed={self.seed}"
        digest = hashlib.sha256(name.encode()).hexdigest()[:16]
        return folder / f"{self.setup.shape}-{digest}" / f"{self.start:08d}-{self.stop:08d}.npz"


def run_setups(
    setups: Sequence[Setup],
    n_instances: int,
    *,
    seed: int = 0,
    folder: Path | None = None,
    n_jobs: int = -1,
    dask_scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,  # noqa: ARG005
) -> list[Runs]:
    """Run instances 0 to `n_instances` of each setup.

    Parameters
    ----------
    setups : sequence of Setup
        The rows of a table.
    n_instances : int
        Instances of each, at least 1.
    seed : int, default 0
        Every instance is seeded by this and its own number, so the results depend neither on
        the number of workers nor on what ran before.
    folder : Path, optional
        Where finished chunks are kept; those that are there already are not run again.
    n_jobs : int, default -1
        Workers on this machine; -1 for one a core.
    dask_scheduler : str, optional
        Address of a dask scheduler whose workers take the place of this machine's. They need
        ransac-fix with its `reproduce` extra.
    progress : callable
        Called with the work done and the whole work, in no particular unit.

    Returns
    -------
    list of Runs
        One for each setup, in the order of instances.

    Raises
    ------
    RansacFixError
        When the folder cannot be written or the scheduler not reached.
    """
    chunks = [
        _Chunk(setup, seed, start, min(start + CHUNK, n_instances))
        for setup in setups
        for start in range(0, n_instances, CHUNK)
    ]
    results: dict[_Chunk, Runs] = {}
    if folder is not None:
        for chunk in chunks:
            stored = _load(chunk.path(folder), chunk.stop - chunk.start)
            if stored is not None:
                results[chunk] = stored
    total = sum(chunk.work for chunk in chunks)
    done = sum(chunk.work for chunk in results)
    progress(done, total)
    missing = [chunk for chunk in chunks if chunk not in results]
    if missing:
        with workers(dask_scheduler):
            parallel = joblib.Parallel(n_jobs=n_jobs, return_as="generator_unordered")
            tasks = (joblib.delayed(_run_chunk)(chunk) for chunk in missing)
            for chunk, runs in parallel(tasks):
                if folder is not None:
                    _store(chunk.path(folder), runs, chunk)
                results[chunk] = runs
                done += chunk.work
                progress(done, total)
    return [
        _joined([results[chunk] for chunk in chunks if chunk.setup == setup]) for setup in setups
    ]


def _run_chunk(chunk: _Chunk) -> tuple[_Chunk, Runs]:
    return chunk, run_instances(chunk.setup, chunk.seed, chunk.start, chunk.stop)


def _joined(parts: Sequence[Runs]) -> Runs:
    return Runs(
        np.concatenate([part.gains for part in parts]),
        np.concatenate([part.trials for part in parts]),
        np.concatenate([part.tests for part in parts]),
    )


def _store(path: Path, runs: Runs, chunk: _Chunk) -> None:
    """Write a chunk so that a kill leaves the whole file or none."""
    try:
        if not path.parent.is_dir():
            path.parent.mkdir(parents=True)
            note = f"{chunk.setup.key()} seed={chunk.seed}\n"
            (path.parent / "setup.txt").write_text(note, encoding="utf-8")
        partial = path.with_suffix(f".partial-{os.getpid()}")
        with partial.open("wb") as file:
            np.savez(file, gains=runs.gains, trials=runs.trials, tests=runs.tests)
        partial.replace(path)
    except OSError as error:
        raise RansacFixError(f"{path}: cannot be written: {error.strerror}") from None


def _load(path: Path, n: int) -> Runs | None:
    """Return a stored chunk; None where there is none, or a damaged one, which is run again."""
    try:
        with np.load(path) as file:
            runs = Runs(file["gains"], file["trials"], file["tests"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    complete = runs.gains.shape == (n, 2, 3) and runs.trials.shape == (n, 2)
    return runs if complete and runs.tests.shape == (n,) else None

"""Hypothesise and verify, with the stopping rule, the sampler and the model passed in."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from ransac_fix.criterion import required_trials
from ransac_fix.reference.interface import (
    BoolArray,
    FloatArray,
    IndexArray,
    KnownSampler,
    Model,
    Sampler,
    StoppingRule,
    SubsetSampler,
)
from ransac_fix.reference.samplers import DistinctSampler

M = TypeVar("M")

Strategy: TypeAlias = Literal["sample", "enumerate", "auto"]
Ended: TypeAlias = Literal["rule", "max_trials", "enumerated", "n_subsets"]

# More subsets than numpy can number with one random integer; no run tries them all.
_UNCOUNTABLE = 2**63


@dataclass(frozen=True, slots=True)
class Candidate(Generic[M]):
    """One model hypothesised in a trial, verified on all measurements.

    Parameters
    ----------
    model
        What the model's `solve` returned.
    inliers : ndarray of bool, shape (n_samples,)
        Measurements with a residual of at most the threshold.
    n_inliers : int
        How many they are.
    """

    model: M
    inliers: BoolArray
    n_inliers: int


@dataclass(frozen=True, slots=True)
class Trial(Generic[M]):
    """One minimal sample and the models through it.

    Parameters
    ----------
    sample : ndarray of int, shape (sample_size,)
        Indices of the measurements drawn.
    candidates : tuple of Candidate
        The models, in the order of the solver; none for a degenerate sample.
    """

    sample: IndexArray
    candidates: tuple[Candidate[M], ...]


@dataclass(frozen=True, slots=True)
class RansacResult(Generic[M]):
    """What a run found, and what its end guarantees.

    Parameters
    ----------
    model : object or None
        The minimal-sample model with the most inliers, the first of equals; None if no model
        had any inlier.
    inliers : ndarray of bool, shape (n_samples,)
        Its inliers.
    n_inliers : int
        How many they are.
    refit : object or None
        The model fitted to all inliers; None where there is no model, refitting failed or was
        not asked for. `inliers` belongs to `model`, the one that the stopping rule judged.
    trials : int
        Samples drawn, degenerate ones included.
    required_trials : int or math.inf
        The stopping rule's number for `n_inliers`; ``inf`` with no model in hand.
    enumerated : bool
        Whether every subset was tried. Then no minimal sample gives a model with more inliers:
        that is certain. Otherwise it is as likely as the stopping rule has it.
    ended : {"rule", "max_trials", "enumerated", "n_subsets"}
        What ended the run: the required number of trials (or `min_trials`, where that is more),
        the caller's cap, every subset tried once, or, where nothing else gave a finite bound,
        as many random samples as there are subsets.
    """

    model: M | None
    inliers: BoolArray
    n_inliers: int
    refit: M | None
    trials: int
    required_trials: int | float
    enumerated: bool
    ended: Ended


def ransac(
    data: npt.ArrayLike,
    model: Model[M],
    *,
    residual_threshold: float,
    confidence: float = 0.99,
    max_trials: int | None = None,
    min_trials: int = 0,
    sampler: Sampler | None = None,
    stopping_rule: StoppingRule | None = None,
    strategy: Strategy = "sample",
    offset: int = 0,
    tested: Literal["trial", "improvement"] = "trial",
    refit: bool = True,
    on_trial: Callable[[int, Trial[M]], object] | None = None,
    rng: int | np.random.Generator | None = None,
) -> RansacResult[M]:
    """Find the model with the most inliers by hypothesise and verify.

    A trial draws one minimal sample, solves for the models through it and counts the inliers of
    each. A model with strictly more inliers than the one in hand replaces it. The run ends after
    the trial with which the number of trials reaches the stopping rule's number for the model in
    hand.

    Parameters
    ----------
    data : array_like of shape (n_samples, columns)
        The measurements, one a row.
    model : Model
        The kind of model; see `ransac_fix.reference.models`.
    residual_threshold : float
        Largest residual of an inlier, in the unit of the model's residuals, itself included.
    confidence : float, default 0.99
        Handed to the stopping rule.
    max_trials : int, optional
        The run ends after this many trials at the latest. None for no cap of the caller's.
    min_trials : int, default 0
        The stopping rule does not end the run before this many trials.
    sampler : Sampler, optional
        Default: `DistinctSampler`.
    stopping_rule : callable, optional
        ``rule(n_inliers, n_samples, sample_size, confidence)``, asked whenever the model in hand
        changes. Default: `ransac_fix.required_trials` for the law the sampler states, which is
        exact for every sampler of this package.
    strategy : {"sample", "enumerate", "auto"}, default "sample"
        ``"sample"`` draws from the sampler. ``"enumerate"`` tries every subset once, in
        lexicographic order, and asks no stopping rule. ``"auto"`` draws subsets in uniformly
        random order and never one twice: it ends by the stopping rule or when every subset has
        been tried, whichever comes first, and so enumerates exactly when the number of subsets
        is below the required number of trials. It remembers what it has drawn, about 100 bytes
        a trial.
    offset : int, default 0
        Trials run beyond the required number. 1 is the program that compares the bound with the
        zero-based index of the trial just done, -1 the one that stops a trial short.
    tested : {"trial", "improvement"}, default "trial"
        When the number of trials is compared with the bound: after every trial, or only after
        one that improved the model in hand, as some programs do by mistake.
    refit : bool, default True
        Whether to fit the model to all inliers at the end.
    on_trial : callable, optional
        Called as ``on_trial(number, trial)`` after each trial, numbered from 1.
    rng : int or numpy.random.Generator, optional
        The random stream. The samples it leads to depend on nothing else: a run with another
        confidence, cap or rule sees the same samples in the same order, for longer or shorter.

    Returns
    -------
    RansacResult

    Raises
    ------
    ValueError
        If an argument is out of range, `data` is not a finite array of at least `sample_size`
        rows with the model's number of columns, or the sampler cannot do what is asked: state
        its law (for the default `stopping_rule`) or number its subsets (for ``"enumerate"`` and
        ``"auto"``).

    Notes
    -----
    No run is endless. While no model is in hand, or where the rule asks for infinitely many
    trials (fewer inliers than a sample holds, confidence 1), and `max_trials` is None, the run
    ends after as many trials as there are subsets of `sample_size` measurements: enough for
    ``"auto"`` and ``"enumerate"`` to have tried them all.

    The guarantee of the rule is that of `ransac_fix.required_trials`: it holds for what may
    still be missed once a model is in hand. Draws without repetition, as ``"auto"`` makes them,
    miss no more often than independent ones, so the rule holds there too.
    """
    problem = _Problem(data, model, residual_threshold, sampler, strategy)
    stop = _Stop(confidence, max_trials, min_trials, stopping_rule, offset, tested)
    return _run(problem, stop, problem.trials(rng), refit, on_trial)


class Recording(Generic[M]):
    """The trials of one random stream, kept so that many runs over it cost the trials once.

    ``Recording(data, model, residual_threshold=t, rng=seed).run(**options)`` returns what
    ``ransac(data, model, residual_threshold=t, rng=seed, **options)`` does: which samples are
    drawn depends on the stream alone, so a run differs from another in where it ends. A trial is
    evaluated when a run first gets that far.

    Parameters
    ----------
    data, model, residual_threshold, sampler, strategy
        As in `ransac`.
    rng : int or numpy.random.Generator, optional
        As in `ransac`. A generator must not be used elsewhere afterwards.

    Raises
    ------
    ValueError
        As `ransac` does.
    """

    def __init__(
        self,
        data: npt.ArrayLike,
        model: Model[M],
        *,
        residual_threshold: float,
        sampler: Sampler | None = None,
        strategy: Strategy = "sample",
        rng: int | np.random.Generator | None = None,
    ) -> None:
        self._problem = _Problem(data, model, residual_threshold, sampler, strategy)
        self._source = self._problem.trials(rng)
        self._trials: list[Trial[M]] = []

    def __len__(self) -> int:
        """Return the number of trials evaluated so far."""
        return len(self._trials)

    def __iter__(self) -> Iterator[Trial[M]]:
        """Yield the trials from the first on, evaluating further ones as they are asked for."""
        return itertools.chain(self._trials, self._further())

    def _further(self) -> Iterator[Trial[M]]:
        """Yield the trials after those that were there when the first is asked for."""
        number = len(self._trials)
        while True:
            if number == len(self._trials):  # no other iterator has been here
                fresh = next(self._source, None)
                if fresh is None:
                    return
                self._trials.append(fresh)
            yield self._trials[number]
            number += 1

    def run(
        self,
        *,
        confidence: float = 0.99,
        max_trials: int | None = None,
        min_trials: int = 0,
        stopping_rule: StoppingRule | None = None,
        offset: int = 0,
        tested: Literal["trial", "improvement"] = "trial",
        refit: bool = True,
        on_trial: Callable[[int, Trial[M]], object] | None = None,
    ) -> RansacResult[M]:
        """Return the result of `ransac` on this stream.

        Parameters
        ----------
        confidence, max_trials, min_trials, stopping_rule, offset, tested, refit, on_trial
            As in `ransac`.

        Returns
        -------
        RansacResult

        Raises
        ------
        ValueError
            As `ransac` does.
        """
        stop = _Stop(confidence, max_trials, min_trials, stopping_rule, offset, tested)
        return _run(self._problem, stop, self, refit, on_trial)


class _Problem(Generic[M]):
    """What is to be solved and how it is sampled: all that the trials of a run depend on."""

    def __init__(
        self,
        data: npt.ArrayLike,
        model: Model[M],
        residual_threshold: float,
        sampler: Sampler | None,
        strategy: Strategy,
    ) -> None:
        self.data = _checked_data(data, model)
        self.model = model
        if not residual_threshold >= 0:
            raise ValueError(f"residual_threshold must not be negative, not {residual_threshold!r}")
        self.threshold = residual_threshold
        if strategy not in ("sample", "enumerate", "auto"):
            raise ValueError(f'strategy must be "sample", "enumerate" or "auto", not {strategy!r}')
        self.strategy = strategy
        self.sampler = _checked_sampler(sampler, self.data, model)
        self.law = self.sampler if isinstance(self.sampler, KnownSampler) else None
        self.subsets = self.sampler if isinstance(self.sampler, SubsetSampler) else None
        if self.subsets is not None:
            self.n_subsets = self.subsets.n_subsets
        elif strategy == "sample":
            self.n_subsets = math.comb(len(self.data), model.sample_size)
        else:
            raise ValueError(
                f'strategy must be "sample": {type(sampler).__name__} cannot number its subsets'
            )

    def trials(self, rng: int | np.random.Generator | None) -> Iterator[Trial[M]]:
        """Return the hypothesised and verified models of one sample after another."""
        data, model = self.data, self.model
        return (
            Trial(sample, tuple([self._verified(found) for found in model.solve(data[sample])]))
            for sample in self._samples(np.random.default_rng(rng))
        )

    def _verified(self, found: M) -> Candidate[M]:
        inliers = self.model.residuals(found, self.data) <= self.threshold
        return Candidate(found, inliers, int(np.count_nonzero(inliers)))

    def _samples(self, rng: np.random.Generator) -> Iterator[IndexArray]:
        if self.subsets is not None and self.strategy == "enumerate":
            return self.subsets.subsets()
        if self.subsets is not None and self.strategy == "auto" and self.n_subsets < _UNCOUNTABLE:
            return _shuffled(self.subsets, rng)
        return _draws(self.sampler, rng)


@dataclass(frozen=True, slots=True)
class _Stop:
    """When a run ends."""

    confidence: float
    max_trials: int | None
    min_trials: int
    stopping_rule: StoppingRule | None
    offset: int
    tested: Literal["trial", "improvement"]

    def check(self, problem: _Problem[Any]) -> None:
        """Raise ValueError for what cannot be, before the first trial."""
        n, k = len(problem.data), problem.model.sample_size
        required_trials(k, n, k, self.confidence)  # the criterion's own check of the confidence
        if self.max_trials is not None and self.max_trials < 1:
            raise ValueError(f"max_trials must be at least 1, not {self.max_trials}")
        if self.min_trials < 0:
            raise ValueError(f"min_trials must not be negative, not {self.min_trials}")
        if self.max_trials is not None and self.min_trials > self.max_trials:
            raise ValueError(
                f"min_trials must not exceed max_trials = {self.max_trials}, not {self.min_trials}"
            )
        if self.tested not in ("trial", "improvement"):
            raise ValueError(f'tested must be "trial" or "improvement", not {self.tested!r}')
        if self.stopping_rule is None and problem.law is None:
            raise ValueError(
                f"stopping_rule must be given: {type(problem.sampler).__name__} does not state "
                "its sampling law"
            )
        if (
            problem.strategy == "enumerate"
            and self.max_trials is not None
            and self.max_trials < problem.n_subsets
        ):
            raise ValueError(
                f"max_trials must be at least the number of subsets, {problem.n_subsets}, or None "
                f'for strategy "enumerate", not {self.max_trials}'
            )

    def required(self, best: Candidate[Any], problem: _Problem[Any]) -> int | float:
        """Return the rule's number of trials for the model in hand."""
        n, k = len(problem.data), problem.model.sample_size
        if self.stopping_rule is not None:
            return self.stopping_rule(best.n_inliers, n, k, self.confidence)
        assert problem.law is not None
        sampling = problem.law.sampling(best.inliers)
        return required_trials(best.n_inliers, n, k, self.confidence, sampling=sampling)


def _run(
    problem: _Problem[M],
    stop: _Stop,
    trials: Iterable[Trial[M]],
    refit: bool,
    on_trial: Callable[[int, Trial[M]], object] | None,
) -> RansacResult[M]:
    """Go through `trials` until it is time to stop."""
    stop.check(problem)
    n_subsets = problem.n_subsets
    cap = math.inf if stop.max_trials is None else stop.max_trials
    # What ends a run that neither the rule nor a cap ends.
    last_resort = max(n_subsets, stop.min_trials) if stop.max_trials is None else math.inf
    repeats = problem.strategy == "sample"
    obeys_rule = problem.strategy != "enumerate"
    each_trial = stop.tested == "trial"

    best: Candidate[M] | None = None
    most = 0
    required: int | float = math.inf
    enough: int | float = math.inf
    ended: Ended = "enumerated"
    number = 0
    for trial in trials:
        number += 1
        improved = False
        for candidate in trial.candidates:
            if candidate.n_inliers > most:
                best, most = candidate, candidate.n_inliers
                improved = True
        if improved and best is not None:
            required = stop.required(best, problem)
            enough = max(required + stop.offset, stop.min_trials)
        if on_trial is not None:
            on_trial(number, trial)
        if number == n_subsets and not repeats:
            break
        if number >= enough and obeys_rule and (improved or each_trial):
            ended = "rule"
            break
        if number >= cap:
            ended = "max_trials"
            break
        if number >= last_resort and repeats and (enough == math.inf or not each_trial):
            ended = "n_subsets"
            break

    enumerated = ended == "enumerated"
    if best is None:
        nothing = np.zeros(len(problem.data), dtype=np.bool_)
        return RansacResult(None, nothing, 0, None, number, required, enumerated, ended)
    return RansacResult(
        model=best.model,
        inliers=best.inliers,
        n_inliers=best.n_inliers,
        refit=problem.model.refit(problem.data[best.inliers]) if refit else None,
        trials=number,
        required_trials=required,
        enumerated=enumerated,
        ended=ended,
    )


def _draws(sampler: Sampler, rng: np.random.Generator) -> Iterator[IndexArray]:
    while True:
        yield sampler.draw(rng)


def _shuffled(sampler: SubsetSampler, rng: np.random.Generator) -> Iterator[IndexArray]:
    """Yield every subset once in uniformly random order.

    A Fisher-Yates shuffle of the subsets' numbers, of which only the places that no longer hold
    their own number are kept.
    """
    moved: dict[int, int] = {}
    for last in range(sampler.n_subsets - 1, -1, -1):
        place = int(rng.integers(last + 1))
        rank = moved.get(place, place)
        if place != last:
            moved[place] = moved.pop(last, last)
        yield sampler.subset(rank)


def _checked_data(data: npt.ArrayLike, model: Model[Any]) -> FloatArray:
    rows: FloatArray = np.ascontiguousarray(data, dtype=np.float64)
    columns = getattr(model, "n_columns", None)
    if rows.ndim != 2 or columns not in (None, rows.shape[1]):
        raise ValueError(
            f"data must have shape (n_samples, {columns or 'columns'}), not {rows.shape}"
        )
    if len(rows) < model.sample_size:
        raise ValueError(
            f"data must have at least {model.sample_size} rows for one sample, not {len(rows)}"
        )
    if not np.isfinite(rows).all():
        raise ValueError("data must be finite: remove the rows with NaN or infinity")
    return rows


def _checked_sampler(sampler: Sampler | None, data: FloatArray, model: Model[Any]) -> Sampler:
    if sampler is None:
        return DistinctSampler(len(data), model.sample_size)
    for name, wanted in (("n_samples", len(data)), ("sample_size", model.sample_size)):
        if getattr(sampler, name, wanted) != wanted:
            raise ValueError(f"sampler must have {name} = {wanted}, not {getattr(sampler, name)}")
    return sampler

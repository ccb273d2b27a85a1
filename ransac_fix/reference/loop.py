"""Hypothesise and verify, with the stopping rule, the sampler and the model passed in."""

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
    rows = _checked_data(data, model)
    sampler = _default_sampler(sampler, rows, model)
    trials = _trials(rows, model, residual_threshold, _samples(sampler, strategy, rng))
    stop = _Stop(
        model=model,
        sampler=sampler,
        n_samples=len(rows),
        confidence=confidence,
        max_trials=max_trials,
        min_trials=min_trials,
        stopping_rule=stopping_rule,
        strategy=strategy,
        offset=offset,
        tested=tested,
    )
    return _run(trials, stop, rows if refit else None, on_trial)


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
        self._data = _checked_data(data, model)
        self._model = model
        self._sampler = _default_sampler(sampler, self._data, model)
        self._strategy: Strategy = strategy
        self._source = _trials(
            self._data, model, residual_threshold, _samples(self._sampler, strategy, rng)
        )
        self._trials: list[Trial[M]] = []

    def __len__(self) -> int:
        """Return the number of trials evaluated so far."""
        return len(self._trials)

    def __iter__(self) -> Iterator[Trial[M]]:
        """Yield the trials from the first on, evaluating further ones as they are asked for."""
        number = 0
        while True:
            if number == len(self._trials):
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
        stop = _Stop(
            model=self._model,
            sampler=self._sampler,
            n_samples=len(self._data),
            confidence=confidence,
            max_trials=max_trials,
            min_trials=min_trials,
            stopping_rule=stopping_rule,
            strategy=self._strategy,
            offset=offset,
            tested=tested,
        )
        return _run(self, stop, self._data if refit else None, on_trial)


@dataclass(frozen=True, slots=True)
class _Stop:
    """When a run ends."""

    model: Model[Any]
    sampler: Sampler
    n_samples: int
    confidence: float
    max_trials: int | None
    min_trials: int
    stopping_rule: StoppingRule | None
    strategy: Strategy
    offset: int
    tested: Literal["trial", "improvement"]

    def __post_init__(self) -> None:
        # The criterion's own check of the confidence, before the first trial.
        required_trials(0, self.n_samples, self.model.sample_size, self.confidence)
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
        if self.stopping_rule is None and not isinstance(self.sampler, KnownSampler):
            raise ValueError(
                f"stopping_rule must be given: {type(self.sampler).__name__} does not state its "
                "sampling law"
            )
        if (
            self.strategy == "enumerate"
            and self.max_trials is not None
            and self.max_trials < self.n_subsets
        ):
            raise ValueError(
                f"max_trials must be at least the number of subsets, {self.n_subsets}, or None "
                f'for strategy "enumerate", not {self.max_trials}'
            )

    @property
    def n_subsets(self) -> int:
        if isinstance(self.sampler, SubsetSampler):
            return self.sampler.n_subsets
        return math.comb(self.n_samples, self.model.sample_size)

    def required(self, best: Candidate[Any]) -> int | float:
        """Return the rule's number of trials for the model in hand."""
        n, k = self.n_samples, self.model.sample_size
        if self.stopping_rule is not None:
            return self.stopping_rule(best.n_inliers, n, k, self.confidence)
        assert isinstance(self.sampler, KnownSampler)
        sampling = self.sampler.sampling(best.inliers)
        return required_trials(best.n_inliers, n, k, self.confidence, sampling=sampling)


def _run(
    trials: Iterable[Trial[M]],
    stop: _Stop,
    refit_data: FloatArray | None,
    on_trial: Callable[[int, Trial[M]], object] | None,
) -> RansacResult[M]:
    """Go through `trials` until it is time to stop."""
    n_subsets = stop.n_subsets
    finite = stop.strategy != "sample"
    cap = math.inf if stop.max_trials is None else stop.max_trials
    # What bounds a run whose rule gives no finite number.
    last_resort = max(n_subsets, stop.min_trials) if stop.max_trials is None else math.inf
    each_trial = stop.tested == "trial"
    obeys_rule = stop.strategy != "enumerate"

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
            required = stop.required(best)
            enough = max(required + stop.offset, stop.min_trials)
        if on_trial is not None:
            on_trial(number, trial)
        if finite and number == n_subsets:
            break
        if obeys_rule and number >= enough and (improved or each_trial):
            ended = "rule"
            break
        if number >= cap:
            ended = "max_trials"
            break
        if number >= last_resort and (enough == math.inf or not each_trial) and not finite:
            ended = "n_subsets"
            break

    if best is None:
        inliers = np.zeros(stop.n_samples, dtype=np.bool_)
        return RansacResult(None, inliers, 0, None, number, required, ended == "enumerated", ended)
    final = None if refit_data is None else stop.model.refit(refit_data[best.inliers])
    return RansacResult(
        model=best.model,
        inliers=best.inliers,
        n_inliers=best.n_inliers,
        refit=final,
        trials=number,
        required_trials=required,
        enumerated=ended == "enumerated",
        ended=ended,
    )


def _trials(
    data: FloatArray, model: Model[M], threshold: float, samples: Iterator[IndexArray]
) -> Iterator[Trial[M]]:
    """Return the hypothesised and verified models of each sample."""
    if not threshold >= 0:
        raise ValueError(f"residual_threshold must not be negative, not {threshold!r}")
    return (
        Trial(sample, tuple(_verify(found, model, data, threshold) for found in models))
        for sample in samples
        for models in (model.solve(data[sample]),)
    )


def _verify(found: M, model: Model[M], data: FloatArray, threshold: float) -> Candidate[M]:
    inliers = model.residuals(found, data) <= threshold
    return Candidate(found, inliers, int(np.count_nonzero(inliers)))


def _samples(
    sampler: Sampler, strategy: Strategy, rng: int | np.random.Generator | None
) -> Iterator[IndexArray]:
    """Return the samples in the order in which a run tries them."""
    if strategy not in ("sample", "enumerate", "auto"):
        raise ValueError(f'strategy must be "sample", "enumerate" or "auto", not {strategy!r}')
    generator = np.random.default_rng(rng)
    if strategy == "sample":
        return _draws(sampler, generator)
    if not isinstance(sampler, SubsetSampler):
        raise ValueError(
            f'strategy must be "sample": {type(sampler).__name__} cannot number its subsets'
        )
    if strategy == "enumerate":
        return sampler.subsets()
    if sampler.n_subsets >= _UNCOUNTABLE:
        return _draws(sampler, generator)
    return _shuffled(sampler, generator)


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


def _default_sampler(sampler: Sampler | None, data: FloatArray, model: Model[Any]) -> Sampler:
    if sampler is None:
        return DistinctSampler(len(data), model.sample_size)
    for name, wanted in (("n_samples", len(data)), ("sample_size", model.sample_size)):
        if getattr(sampler, name, wanted) != wanted:
            raise ValueError(f"sampler must have {name} = {wanted}, not {getattr(sampler, name)}")
    return sampler

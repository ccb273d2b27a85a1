"""From exact points to the one stopping law that all of them follow."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from ransac_fix.audit.drawing import Drawing, Strata, drawings
from ransac_fix.audit.model import Assumed, Point, StoppingLaw
from ransac_fix.criterion import all_inlier_probability, approximate_all_inlier_probability

# The shift phi that a sane program can have (see StoppingLaw): rounding, one or two trials more
# or fewer, a test after the trial.
_PHI = (-2.6, 5.1)
# Where one draw gives several models, phi varies from stream to stream by up to this.
_MOST_SPREAD = 4.1
# Error of phi beyond its bracket: the library computes in floating point too.
_SLACK = 0.02
# Multipliers that programs use, and those that are looked for when none of these fits.
_USUAL_MULTIPLIERS = (1.0, 3.0, 2.0, 1.5)
_OTHER_MULTIPLIERS = tuple(i / 4 for i in range(2, 41) if i / 4 not in _USUAL_MULTIPLIERS)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A probability that a stopping rule may assume.

    Parameters
    ----------
    assumed : str
        Which formula.
    sample_size : int
        k.
    inlier_offset : int
        Added to I.
    truncated : bool
        Whether I is ``int(I / n * n)``.
    quota : tuple of int
        Parts of the sample, where P goes by strata; see `Drawing`.
    """

    assumed: Assumed
    sample_size: int
    inlier_offset: int = 0
    truncated: bool = False
    quota: tuple[int, ...] = ()

    def probability(self, n_inliers: int, n: int, strata: Strata = ()) -> float:
        """Return P; 0 where it needs strata and is given none.

        Parameters
        ----------
        n_inliers, n : int
            I and n.
        strata : tuple of (inliers, measurements), optional
            How these fall into strata.
        """
        by_strata = self._by_strata
        if by_strata is not None:
            if not strata or any(n < 1 for _, n in strata):
                return 0.0
            exact = self.assumed in ("stratified", "weighted")
            return by_strata.probability(strata) if exact else by_strata.independent(strata)
        count = n_inliers + self.inlier_offset
        if self.truncated:
            count = int(count / n * n)
        count = min(max(count, 0), n)
        if self.sample_size > n:
            return 0.0
        if self.assumed == "approximate":
            return approximate_all_inlier_probability(count, n, self.sample_size)
        sampling: Literal["distinct", "replacement"] = (
            "replacement" if self.assumed == "replacement" else "distinct"
        )
        return all_inlier_probability(count, n, self.sample_size, sampling=sampling)

    @property
    def _by_strata(self) -> Drawing | None:
        match self.assumed:
            case "stratified" | "approximate stratified":
                return Drawing("stratified", self.sample_size, self.quota)
            case "weighted" | "approximate weighted":
                return Drawing("weighted", self.sample_size, self.quota)
        return None

    def describe(self) -> str:
        """P as a formula in I, n and k."""
        by_strata = self._by_strata
        if by_strata is not None:
            return by_strata.formula(exact=self.assumed in ("stratified", "weighted"))
        count = f"(I{self.inlier_offset:+d})" if self.inlier_offset else "I"
        if self.truncated:
            count = f"int({count}/n*n)"
        k = self.sample_size
        if self.assumed == "approximate":
            return f"({count}/n)^{k}"
        if self.assumed == "replacement":
            return f"falling({count},{k})/n^{k}"
        return f"C({count},{k})/C(n,{k})"


def candidates(sample_size: int, n_strata: int = 1) -> Iterator[Candidate]:
    """Yield the laws that are tried, the likelier first.

    Parameters
    ----------
    sample_size : int
        k as documented; programs use others too.
    n_strata : int, default 1
        Strata of the measurements.
    """
    sizes = sorted(
        range(max(1, sample_size - 3), sample_size + 4), key=lambda size: abs(size - sample_size)
    )
    for size in sizes:
        for offset in (0, 1, -1):
            for assumed in ("distinct", "approximate", "replacement"):
                yield Candidate(assumed, size, offset)
    yield Candidate("distinct", sample_size, 0, truncated=True)
    for drawing in drawings(sample_size, n_strata):
        if drawing.drawn == "stratified":
            yield Candidate("stratified", sample_size, quota=drawing.quota)
            yield Candidate("approximate stratified", sample_size, quota=drawing.quota)
        elif drawing.drawn == "weighted":
            yield Candidate("weighted", sample_size, quota=drawing.quota)
            yield Candidate("approximate weighted", sample_size, quota=drawing.quota)


@dataclass(frozen=True, slots=True)
class Fit:
    """What the points say.

    Parameters
    ----------
    law : StoppingLaw or None
        The law, where exactly one class fits.
    rivals : tuple of StoppingLaw
        The laws that fit where more than one class does.
    implied_probability : float or None
        P implied by the points on the first (n, I), where no law fits.
    """

    law: StoppingLaw | None
    rivals: tuple[StoppingLaw, ...] = ()
    implied_probability: float | None = None


def fit(points: Sequence[Point], sample_size: int) -> Fit:
    """Find the law that every point follows.

    Parameters
    ----------
    points : sequence of Point
        At least four, on at least two (n, I).
    sample_size : int
        k as documented.

    Returns
    -------
    Fit
    """
    if len(points) < 4 or len({(p.n, p.n_inliers) for p in points}) < 2:
        return Fit(None, (), _implied_probability(points))
    for tested in ("every trial", "on improvement"):
        if tested == "on improvement" and any(point.kind == "count" for point in points):
            continue
        for spread, usual in ((False, True), (True, True), (False, False)):
            found = list(_fitting(points, sample_size, tested, spread, usual))
            found = _distinguishable(found, points)
            if len(found) == 1:
                return Fit(found[0])
            if found:
                return Fit(None, tuple(found))
    return Fit(None, (), _implied_probability(points))


def law_probability(law: StoppingLaw, n_inliers: int, n: int, strata: Strata = ()) -> float:
    """Return the P that a law assumes; see `Candidate.probability`."""
    return _candidate(law).probability(n_inliers, n, strata)


def assumption(law: StoppingLaw) -> str:
    """P that a law assumes, as a formula in I, n and k."""
    return _candidate(law).describe()


def _candidate(law: StoppingLaw) -> Candidate:
    return Candidate(law.assumed, law.sample_size, law.inlier_offset, law.truncated, law.quota)


def _fitting(
    points: Sequence[Point],
    sample_size: int,
    tested: Literal["every trial", "on improvement"],
    spread: bool,
    usual: bool,
) -> Iterator[StoppingLaw]:
    # A rule consulted with the model A allows the trial after A's, or all of them.
    trials = [p.trials if tested == "every trial" else p.in_hand + 1 for p in points]
    n_strata = max([1, *(len(point.strata) for point in points)])
    for candidate in candidates(sample_size, n_strata):
        scales = []
        for point in points:
            probability = candidate.probability(point.n_inliers, point.n, point.strata)
            if not 0 < probability < 1:
                break
            scales.append(-math.log1p(-probability))
        if len(scales) < len(points):
            continue
        x_low = [p.u_low / scale for p, scale in zip(points, scales, strict=True)]
        x_high = [p.u / scale for p, scale in zip(points, scales, strict=True)]
        for multiplier in _USUAL_MULTIPLIERS if usual else _multiplier(x_high, trials):
            phi = _phi(x_low, x_high, trials, multiplier, spread)
            if phi is not None:
                yield StoppingLaw(
                    assumed=candidate.assumed,
                    sample_size=candidate.sample_size,
                    inlier_offset=candidate.inlier_offset,
                    multiplier=multiplier,
                    phi=phi,
                    tested=tested,
                    truncated=candidate.truncated,
                    formula=formula(candidate, multiplier, phi),
                    quota=candidate.quota,
                )
                break


def _multiplier(x: Sequence[float], trials: Sequence[int]) -> tuple[float, ...]:
    """Return the factor of the least-squares line through the points, if it is a round number."""
    mean_x, mean_t = sum(x) / len(x), sum(trials) / len(trials)
    variance = sum((a - mean_x) ** 2 for a in x)
    if variance == 0:
        return ()
    slope = sum((a - mean_x) * (t - mean_t) for a, t in zip(x, trials, strict=True)) / variance
    nearest = min(_OTHER_MULTIPLIERS, key=lambda value: abs(value - slope))
    return (nearest,) if abs(nearest - slope) < 0.005 * slope else ()


def _phi(
    x_low: Sequence[float],
    x_high: Sequence[float],
    trials: Sequence[int],
    multiplier: float,
    spread: bool,
) -> tuple[float, float] | None:
    """Return the shift that all points share; with `spread`, the range of half-integers."""
    lows = [t - multiplier * x - _SLACK for t, x in zip(trials, x_high, strict=True)]
    highs = [t - multiplier * x + _SLACK for t, x in zip(trials, x_low, strict=True)]
    if min(lows) < _PHI[0] or max(highs) > _PHI[1]:
        return None
    if not spread:
        low, high = max(lows), min(highs)
        if low > high:
            return None
        value = _rounded(low, high)
        return value, value
    steps = []
    for low, high in zip(lows, highs, strict=True):
        step = round(low + high) / 2
        if not low <= step <= high:
            return None
        steps.append(step)
    if max(steps) - min(steps) > _MOST_SPREAD:
        return None
    return min(steps), max(steps)


def _rounded(low: float, high: float) -> float:
    """Return the half-integer within the range, else its middle."""
    half = round(low + high) / 2
    return half if low <= half <= high else round((low + high) / 2, 3)


def _distinguishable(laws: Iterable[StoppingLaw], points: Sequence[Point]) -> list[StoppingLaw]:
    """Drop laws that assume the same P at every point as a likelier one."""
    kept: list[StoppingLaw] = []
    seen: set[tuple[float, ...]] = set()
    for law in laws:
        key = tuple(
            float(f"{law_probability(law, p.n_inliers, p.n, p.strata):.12g}") for p in points
        )
        if key not in seen:
            seen.add(key)
            kept.append(law)
    return kept


def _implied_probability(points: Sequence[Point]) -> float | None:
    """P from the slope between the two most distant points on one (n, I)."""
    groups: dict[tuple[int, int, Strata], list[Point]] = {}
    for point in points:
        groups.setdefault((point.n, point.n_inliers, point.strata), []).append(point)
    for group in groups.values():
        first = min(group, key=lambda point: point.trials)
        last = max(group, key=lambda point: point.trials)
        if last.trials > first.trials and last.u > first.u:
            return -math.expm1(-(last.u - first.u) / (last.trials - first.trials))
    return None


_ROUNDINGS = {0.0: "floor({})", 0.5: "round({})", 1.0: "ceil({})", 1.5: "ceil({} + 0.5)"}


def formula(candidate: Candidate, multiplier: float, phi: tuple[float, float] | None) -> str:
    """Write one representative of the class of laws.

    Parameters
    ----------
    candidate : Candidate
        The probability.
    multiplier : float
        Factor on the number of trials.
    phi : tuple of float or None
        Smallest and largest shift; None where it is not known.

    Returns
    -------
    str
        For instance ``ceil(3 * ln(1-s)/ln(1-(I/n)^4)) + 1``.
    """
    factor = "" if multiplier == 1 else f"{multiplier:g} * "
    inner = f"{factor}ln(1-s)/ln(1-{candidate.describe()})"
    if phi is None:
        return inner
    low, high = phi
    if low != high:
        return f"{inner} + {low:g} to {high:g}"
    whole = math.floor(low) if low < 0 or low > 1.5 else 0
    rest = low - whole
    if low > 1.5 and rest in (0.0, 0.5):
        # ceil(x) + 1 reads better than floor(x) + 2.
        whole, rest = whole - 1, rest + 1
    if rest not in _ROUNDINGS:
        return f"floor({inner} + {low:g})"
    text = _ROUNDINGS[rest].format(inner)
    return text if whole == 0 else f"{text} {'+' if whole > 0 else '-'} {abs(whole)}"

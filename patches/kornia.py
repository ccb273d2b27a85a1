"""kornia: `kornia.geometry.RANSAC`.

Up to 0.8.2 ``RANSAC.max_samples_by_conf`` assumes p**k, and the loop in ``RANSAC.forward``
compares it with the samples drawn only in the batch that improves the best model: later batches
run to the end of the budget. Here the rule is made exact, and the loop is mended from outside:
each batch begins with a call of ``RANSAC.sample``, and once the bound is reached that call
draws nothing more, which the loop skips. 0.8.3 has the exact formula, but feeds it a score in
place of the number of inliers and stops at once where the model has no more inliers than a
sample: it is refused, and so are 0.7.1 and 0.7.2, whose bound is always negative. 0.9.0 is exact
and is left alone. Samples are drawn without replacement.

``from ransac_fix.patches.kornia import RANSAC`` is the exact module without any change for the
rest of the program; where kornia is exact already it is kornia's own class.
"""

import functools
import inspect
import math
from contextvars import ContextVar
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.rules import exact_rule, examine
from ransac_fix.patching.watching import note

if TYPE_CHECKING:
    from kornia.geometry import RANSAC

__all__ = ["PATCH", "RANSAC"]

# The methods the mending relies on, with their arguments.
_SHAPE = {
    "forward": ("self", "kp1", "kp2", "weights"),
    "sample": ("self", "sample_size", "pop_size", "batch_size", "device"),
    "max_samples_by_conf": ("n_inl", "num_tc", "sample_size", "conf"),
    "remove_bad_samples": ("self", "kp1", "kp2"),
    "estimate_model_from_minsample": ("self", "kp1", "kp2"),
}
# What the loop must do by these names.
_CALLED = ("max_iter", "batch_size", *list(_SHAPE)[1:])


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the rule, and four methods through which the loop is mended."""
    cls = getattr(module, "RANSAC", None)
    if not isinstance(cls, type):
        raise PatchNotApplicable(f"{module.__name__} has no class RANSAC")
    rule = getattr(cls, "max_samples_by_conf", None)
    if not callable(rule):
        raise PatchNotApplicable("RANSAC has no method max_samples_by_conf")
    if rule(12, 60, 4, 0.99) < 0:
        raise PatchNotApplicable(
            "a wrong sign in its rule makes every number of trials negative, so that it stops at"
            " the first model; 0.7.1 and 0.7.2 alone have it, use 0.7.3 or newer"
        )
    facts = examine(rule, "RANSAC.max_samples_by_conf")
    if facts.assumes == "exact":
        if rule(3, 10, 4, 0.99) <= 1:
            raise PatchNotApplicable(
                "its formula is exact but its loop is not: it passes a score as the number of"
                " inliers, and stops at once where the model has no more inliers than a sample;"
                " use kornia 0.9.0 or newer, which is exact"
            )
        return ()
    for name, parameters in _SHAPE.items():
        found = tuple(inspect.signature(getattr(cls, name, None) or print).parameters)
        if found != parameters:
            raise PatchNotApplicable(
                f"RANSAC.{name} takes {', '.join(found)} and not {', '.join(parameters)}"
            )
    forward = inspect.unwrap(cls.forward)  # type: ignore[attr-defined]
    assert isinstance(forward, FunctionType)
    missing = [name for name in _CALLED if name not in forward.__code__.co_names]
    if missing:
        raise PatchNotApplicable(f"the loop in RANSAC.forward does not use {', '.join(missing)}")
    exact = exact_rule(rule, facts)
    return tuple(
        Replacement(holder=cls, name=name, exact=make(vars(cls)[name], exact))
        for name, make in _MENDED.items()
    )


class _Run:
    """One call of ``forward``: how many samples it has drawn, and how many are enough."""

    __slots__ = ("drawn", "enough", "owner")

    def __init__(self, owner: object) -> None:
        self.owner = owner
        self.drawn = 0
        self.enough = math.inf

    @property
    def is_over(self) -> bool:
        return self.drawn >= self.enough


_RUN: ContextVar[_Run | None] = ContextVar("ransac_fix kornia run", default=None)


def _run_of(owner: object) -> _Run | None:
    """Return the run under way, unless the method was called by someone else than its loop."""
    run = _RUN.get()
    return run if run is not None and run.owner is owner else None


def _forward(original: Any, _exact: Any) -> Any:
    def forward(self: Any, *args: Any, **kwargs: Any) -> Any:
        token = _RUN.set(_Run(self))
        try:
            return original(self, *args, **kwargs)
        finally:
            _RUN.reset(token)

    return forward


def _max_samples_by_conf(_original: Any, exact: Any) -> Any:
    def max_samples_by_conf(*args: Any, **kwargs: Any) -> Any:
        trials = exact(*args, **kwargs)
        run = _RUN.get()
        if run is not None:
            run.enough = trials
        return trials

    return max_samples_by_conf


def _sample(original: Any, _exact: Any) -> Any:
    def sample(
        self: Any, sample_size: int, pop_size: int, batch_size: int, *args: Any, **kwargs: Any
    ) -> Any:
        run = _run_of(self)
        if run is not None:
            if run.is_over:
                batch_size = 0
            run.drawn += batch_size
        return original(self, sample_size, pop_size, batch_size, *args, **kwargs)

    return sample


def _remove_bad_samples(original: Any, _exact: Any) -> Any:
    def remove_bad_samples(self: Any, kp1: Any, kp2: Any) -> Any:
        run = _run_of(self)
        if run is not None and run.is_over and len(kp1) == 0:
            return kp1, kp2
        return original(self, kp1, kp2)

    return remove_bad_samples


def _estimate_model_from_minsample(original: Any, _exact: Any) -> Any:
    def estimate_model_from_minsample(self: Any, kp1: Any, kp2: Any) -> Any:
        run = _run_of(self)
        if run is not None and run.is_over and len(kp1) == 0:
            return kp1.new_zeros((0, 3, 3))
        return original(self, kp1, kp2)

    return estimate_model_from_minsample


_MENDED = {
    "forward": _forward,
    "max_samples_by_conf": _max_samples_by_conf,
    "sample": _sample,
    "remove_bad_samples": _remove_bad_samples,
    "estimate_model_from_minsample": _estimate_model_from_minsample,
}


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: ``RANSAC.forward``."""
    original = own_function(module.RANSAC, "forward")
    if original is None:
        raise PatchNotApplicable("RANSAC has no method forward")

    def forward(self: Any, *args: Any, **kwargs: Any) -> Any:
        result = original(self, *args, **kwargs)
        mask, k = result[1], self.minimal_sample_size
        n_samples, n_inliers = mask.numel(), int(mask.sum())
        sizes = self.batch_size, self.max_iter
        uniform = not getattr(self, "prosac_sampling", False)
        if n_inliers > 0 and uniform and all(isinstance(size, int) for size in sizes):
            limit = self.batch_size * self.max_iter
            if getattr(self, "max_samples", None) is not None:
                limit = min(limit, self.max_samples)
            rule = self.max_samples_by_conf(n_inliers, n_samples, k, self.confidence)
            # The last batch may hold more.
            trials = min(max(rule, 1), limit)
            note(n_inliers, n_samples, k, self.confidence, trials, limit)
        return result

    return (Replacement(holder=module.RANSAC, name="forward", exact=forward),)


PATCH = LibraryPatch(
    system="kornia",
    requirements=("kornia>=0.6.1,<=0.9.0,!=0.7.1,!=0.7.2,!=0.8.3",),
    modules=("kornia.geometry.ransac",),
    plan=plan,
    observe=observe,
)


def _drop_in() -> type:
    from kornia.geometry import RANSAC as Original  # noqa: N811

    from ransac_fix.patching.engine import planned

    # The methods of the plan, in a subclass: kornia's own class needs no change at all.
    members = {
        replacement.name: _member(vars(Original)[replacement.name], replacement.exact)
        for replacement in planned(PATCH)
    }
    if not members:
        return Original  # type: ignore[no-any-return]
    names = {"__module__": __name__, "__doc__": Original.__doc__}
    return type("RANSAC", (Original,), {**names, **members})


def _member(original: Any, exact: Any) -> Any:
    @functools.wraps(inspect.unwrap(getattr(original, "__func__", original)))
    def method(*args: Any, **kwargs: Any) -> Any:
        return exact(*args, **kwargs)

    return staticmethod(method) if isinstance(original, staticmethod) else method


def __getattr__(name: str) -> object:
    if name != "RANSAC":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, _drop_in())

"""scikit-image: `skimage.measure.ransac`.

The rule is ``_dynamic_max_trials``, called from ``ransac`` in the same module; samples are drawn
without replacement. Up to 0.26 that module is ``skimage.measure.fit``. From 0.27 it is
``_skimage2.measure.fit``, and the old one only re-exports its names. The default of
``max_trials=100`` stays a bound, and the default ``stop_probability=1`` is taken as 1 - 2**-52,
as the library does.

``from ransac_fix.patches.scikit_image import ransac`` is the exact function without any change
for the rest of the program.
"""

import functools
import inspect
import sys
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.rules import count_rule
from ransac_fix.patching.watching import note

if TYPE_CHECKING:
    from skimage.measure import ransac

__all__ = ["PATCH", "ransac"]


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace, in the module where ``ransac`` looks its rule up."""
    return count_rule(
        module,
        "_dynamic_max_trials",
        caller="ransac",
        parameters=("n_inliers", "n_samples", "min_samples", "probability"),
        limit="max_trials",
    )


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: ``ransac``, in the module where it looks its rule up."""
    from numpy import count_nonzero

    original = own_function(module, "ransac")
    home = (
        sys.modules.get(getattr(inspect.unwrap(original), "__module__", "")) if original else None
    )
    if original is None or home is None or not hasattr(home, "_dynamic_max_trials"):
        raise PatchNotApplicable(f"{module.__name__} has no function ransac with a rule beside it")
    if home is not module and home.__name__ in PATCH.modules:
        return ()  # watched there
    parameters = inspect.signature(original).parameters
    for name in ("min_samples", "max_trials", "stop_sample_num", "stop_probability"):
        if name not in parameters:
            raise PatchNotApplicable(f"{module.__name__}.ransac takes no {name}")
    names = tuple(parameters)
    defaults = {name: parameter.default for name, parameter in parameters.items()}
    highest = 1.0 - sys.float_info.epsilon

    def ransac(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        inliers = result[1]
        if inliers is not None:
            settings = {**defaults, **dict(zip(names, args)), **kwargs}  # noqa: B905 -- fewer arguments
            k, limit = settings["min_samples"], settings["max_trials"]
            n_samples, n_inliers = len(inliers), int(count_nonzero(inliers))
            confidence = min(settings["stop_probability"], highest)
            # With this the user asks for an end of another kind.
            if n_inliers < settings["stop_sample_num"]:
                note(n_inliers, n_samples, k, confidence, None, limit)
        return result

    return (Replacement(holder=module, name="ransac", exact=ransac),)


PATCH = LibraryPatch(
    system="scikit-image",
    requirements=("scikit-image>=0.20,<=0.27.0rc1",),
    modules=("skimage.measure.fit", "_skimage2.measure.fit"),
    plan=plan,
    observe=observe,
)


def _drop_in() -> Callable[..., Any]:
    from skimage.measure import ransac as original

    from ransac_fix.patching.engine import exactly, planned

    if not planned(PATCH):
        return original  # type: ignore[no-any-return]

    @functools.wraps(original)
    def ransac(*args: Any, **kwargs: Any) -> Any:
        with exactly(PATCH):
            return original(*args, **kwargs)

    ransac.__module__ = __name__
    return ransac


def __getattr__(name: str) -> object:
    if name != "ransac":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, _drop_in())

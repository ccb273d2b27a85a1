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

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.rules import count_rule, examine
from ransac_fix.patching.watching import CURRENT, note

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
    import numpy as np

    original = own_function(module, "ransac")
    home = (
        sys.modules.get(getattr(inspect.unwrap(original), "__module__", "")) if original else None
    )
    if original is None or home is None or not hasattr(home, "_dynamic_max_trials"):
        raise PatchNotApplicable(f"{module.__name__} has no function ransac with a rule beside it")
    if home is not module and home.__name__ in PATCH.modules:
        return ()  # watched there
    parameters = inspect.signature(original).parameters
    places = {name: place for place, name in enumerate(parameters)}
    settings = [
        (name, places[name], parameters[name].default)
        for name in ("min_samples", "max_trials", "stop_sample_num", "stop_probability")
    ]
    rule = own_function(home, "_dynamic_max_trials")
    assert rule is not None
    is_exact = examine(rule, f"{home.__name__}._dynamic_max_trials").assumes == "exact"
    highest = 1.0 - sys.float_info.epsilon

    def ransac(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        inliers = result[1]
        if inliers is not None:
            k, limit, enough, confidence = [
                args[place] if place < len(args) else kwargs.get(name, default)
                for name, place, default in settings
            ]
            n_samples, n_inliers = len(inliers), int(np.count_nonzero(inliers))
            confidence = min(confidence, highest)
            # With this the user asks for an end of another kind.
            if n_inliers < enough:
                watched = CURRENT.get()
                exact = is_exact or (watched is not None and watched.exact)
                # The library's own takes longer: it works on arrays.
                law = required_trials if exact else approximate_required_trials
                trials = max(min(law(n_inliers, n_samples, k, confidence), limit), 1)
                note(n_inliers, n_samples, k, confidence, trials, limit)
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

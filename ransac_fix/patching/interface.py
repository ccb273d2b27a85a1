"""What a library's patch is made of, and how to add one.

A patch is one file that exports one `LibraryPatch` named ``PATCH``, found through the
entry-point group ``ransac_fix.patches``::

    # acme_ransac_fix.py
    from types import ModuleType

    from ransac_fix.patching.interface import LibraryPatch, Replacement
    from ransac_fix.patching.rules import count_rule


    def plan(module: ModuleType) -> tuple[Replacement, ...]:
        return count_rule(
            module,
            "_trials",  # the function that computes the number of trials ...
            caller="Estimator.fit",  # ... called by name from the loop in here,
            parameters=("n_inliers", "n_samples", "sample_size", "confidence"),
            limit="max_trials",  # whose bound is this local variable
        )


    PATCH = LibraryPatch(
        system="acme",
        requirements=("acme>=2.0,<3",),
        modules=("acme.robust",),
        plan=plan,
    )

and in the ``pyproject.toml`` of the package that ships it::

    [project.entry-points."ransac_fix.patches"]
    acme = "acme_ransac_fix"

The file must not import the library at its top level: it is read to learn which imports to
wait for. The engine does the rest: it calls `plan` when the library has been imported (or at
once, where it already is), keeps the originals, puts a function in their place that passes
calls on to the original or to the exact one, and undoes it.

What a plan must hold to:

- It looks before it leaps: signature, a few known values, and that the loop really looks the
  name up where it will be replaced. What it does not know it refuses with
  `ransac_fix.errors.PatchNotApplicable` and one sentence why. It never guesses.
- A library that is exact already gives an empty plan.
- It changes the assumed probability and nothing else: return type, guards and limits stay the
  library's, and a bound that was finite stays finite. Where the best model has fewer inliers
  than a sample and the user set no finite cap, the library's own value stands.
- It draws in nothing heavy: the library is there already, `ransac_fix.criterion` is light.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

__all__ = ["LibraryPatch", "Plan", "Replacement"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Replacement:
    """One attribute, and the function that stands in for it while the patch is in force.

    Parameters
    ----------
    holder : module or class
        Where the library's own code looks the name up. A module that only re-exports the name
        is not its holder: replacing it there would change nothing.
    name : str
        The attribute. Static methods stay static methods.
    exact : callable
        Called with the arguments of the original, ``self`` included. It may call the original.
    """

    holder: ModuleType | type
    name: str
    exact: Callable[..., Any]


Plan = Callable[[ModuleType], tuple[Replacement, ...]]
"""Given one of the patch's imported modules, return what to replace.

An empty tuple says that the library is exact already. Raises
`ransac_fix.errors.PatchNotApplicable` when the module is not of a known shape.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LibraryPatch:
    """How one library is made exact at run time.

    Parameters
    ----------
    system : str
        The name users type, such as ``"scikit-learn"``. Distribution names (from
        `requirements`) and import names (from `modules`) are understood too.
    requirements : tuple of str
        The releases the patch was tried on, as requirement strings, one a distribution. Other
        releases are patched when the plan finds them of the same shape, and `status` says so.
    modules : tuple of str
        Full names of the modules whose import completes what `plan` needs. Any one is enough.
    plan : callable
        See `Plan`.
    observe : callable, optional
        Like `plan`, for `ransac_fix.trace`: the functions that users call, exact already or
        not. While a program is traced each `Replacement.exact` runs in the original's place; it
        calls the original once, changes nothing, and says what it ran through
        `ransac_fix.patching.missing.missing_trials` or `ransac_fix.patching.watching.note`.
        What says nothing is counted as a call whose RANSAC cannot be seen.
    wraps : bool, default False
        The functions replaced run a compiled library once more for the trials that its own rule
        leaves out; the rule itself stays. Such a library's points cannot be read off one random
        stream: the audit counts its trials and tests its outcomes instead.
    counts_trials : bool, default False
        The trials it tells of are what the library reports, not the least its rule asks for.
    """

    system: str
    requirements: tuple[str, ...]
    modules: tuple[str, ...]
    plan: Plan
    observe: Plan | None = None
    wraps: bool = False
    counts_trials: bool = False

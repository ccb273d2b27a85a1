"""RFX101, the call into a library that undersamples."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from ransac_fix.scan.findings import Certainty, Finding, Location, Related
from ransac_fix.scan.form import (
    Assign,
    Call,
    Expr,
    Import,
    Name,
    Num,
    Stmt,
)
from ransac_fix.scan.rules.base import Rule, ScannedFile
from ransac_fix.scan.walk import expressions, statements
from ransac_fix.systems import System, load_systems

if TYPE_CHECKING:
    from ransac_fix.scan.releases import Release
    from ransac_fix.verdicts import StoredVerdict

# The releases and the verdicts are loaded when a call is found, and the scan of most files not
# slowed down by them.

# What OpenCV does where a call names no method; other functions have one method or say it.
_DEFAULT_METHOD = {
    "estimateAffine2D": "RANSAC",
    "estimateAffinePartial2D": "RANSAC",
    "estimateTranslation2D": "RANSAC",
    "findEssentialMat": "RANSAC",
    "findFundamentalMat": "RANSAC",
    "findHomography": "none",
}
_METHOD = re.compile(
    r"^(?:FM_|CV_)?(RANSAC|LMEDS|RHO|8POINT|7POINT|USAC_\w+|SOLVEPNP_\w+)$", re.IGNORECASE
)
# Keywords that limit the trials, whatever the rule says.
_LIMITS = re.compile(
    r"^(?:max|min|num)_?(?:trials|iters?|iterations)$|^iterationsCount$", re.IGNORECASE
)
# What makes the libraries of a program exact at run time.
_PATCHED = re.compile(r"\bransac_fix(?:\.auto\b|\.patch|\s+import\s+[^#\n]*\b(?:auto|patch))")
# A confidence that a library must be given before its rule can end a run.
_ASKED_FOR = {"scikit-image": ("stop_probability", 8)}
_NOTES = {
    "opencv": "its cap on trials may end a run first",
    "scikit-image": "max_trials, 100 by default, may end a run first",
    "scikit-learn": "max_trials, 100 by default, may end a run first",
    "poselib": "min_iterations (1000) and dyn_num_trials_mult (3), its defaults, mostly hide it",
}


class UndersamplingLibrary(Rule):
    """Call into a library whose stopping rule undersamples, in the release that is used.

    What it does
    ------------
    Finds calls of functions and classes that were measured to undersample, through imports and
    aliases: ``skimage.measure.ransac``, ``sklearn.linear_model.RANSACRegressor``,
    ``cv2.findHomography`` with a method that is RANSAC, and others. The release is that of the
    current environment, or of the interpreter named by ``--python``; where neither has the library,
    that of the closest lock file (``uv.lock``, ``poetry.lock``, ``pdm.lock``, ``pylock.toml``,
    ``Pipfile.lock``), requirements file or ``pyproject.toml``. A range of releases is answered when
    every release measured in it agrees, and the finding says so when they do not.

    It is off by default: the fault is not in the code that is scanned. ``--select RFX101`` checks
    it alone, ``--select RFX`` with all others.

    Why is this bad
    ---------------
    As in RFX001: the library stops before the trials that the confidence asks for. What it does was
    measured, not read; a release that was not measured is not judged by its neighbours, and the
    certainty is low then.

    Use instead
    -----------
    A release that is exact, where there is one. Otherwise ``import ransac_fix.auto``, or
    ``ransac-fix run``, which make the library exact at run time.

    Fix safety
    ----------
    There is no fix in source. The finding names the release to upgrade to, or the patch of
    ``ransac_fix`` that makes the installed one exact.
    """

    code = "RFX101"
    name = "undersampling-library"
    summary = "call into a library that undersamples, in the release that is used"
    reads_everything = True
    default = False
    valid: ClassVar[dict[str, str]] = {
        "Least squares draws nothing.": """
import cv2

def fit(a, b):
    return cv2.findHomography(a, b)
""",
        "Nor does the least median stop by this rule.": """
import cv2

H, mask = cv2.findHomography([], [], cv2.LMEDS)
""",
        "Without a confidence scikit-image runs all its trials.": """
from skimage.measure import LineModelND, ransac

model, inliers = ransac([], LineModelND, 2, 1.0, max_trials=500)
""",
        "A function of that name from elsewhere.": """
from mylib import ransac

ransac([], None, 2, 1.0, stop_probability=0.99)
""",
        "The libraries of this program are patched.": """
import ransac_fix.auto
from sklearn.linear_model import RANSACRegressor

RANSACRegressor()
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "By another name.": """
from skimage.measure import LineModelND, ransac as r

model, inliers = r([], LineModelND, 2, 1.0, stop_probability=0.99)
""",
        "Through the modules.": """
import sklearn.linear_model as lm

model = lm.RANSACRegressor(max_trials=50)
""",
        "With the method that OpenCV uses by default.": """
import cv2 as cv

def fit(a, b):
    return cv.findFundamentalMat(a, b)
""",
        "Through a name of its own.": """
import cv2

find = cv2.findHomography
H, mask = find([], [], cv2.RANSAC, 3.0)
""",
    }

    def needs(self) -> tuple[bytes, ...]:
        """Ask for the names of the libraries."""
        return tuple(module for module, _ in _gates())

    def concerns(self, lowered: bytes) -> bool:
        """Ask for every file that names a library and one of its functions."""
        return any(
            module in lowered and any(name in lowered for name in names)
            for module, names in _gates()
        )

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the calls."""
        if file.language == "c++":
            return
        body = file.everything().body
        bound = _bound(body)
        if _PATCHED.search(file.text.source):
            return
        seen: set[object] = set()
        for expr, _, _ in expressions(body, None, 0):
            if not isinstance(expr, Call) or expr.span is None or expr.span in seen:
                continue
            seen.add(expr.span)
            finding = self._finding(expr, _resolved(expr, bound), file)
            if finding is not None:
                yield finding

    def _finding(self, call: Call, path: str, file: ScannedFile) -> Finding | None:
        from ransac_fix.scan.releases import release_of

        system = _system(path)
        function = path.rpartition(".")[2]
        if system is None or call.span is None or not _is_asked_for(call, system):
            return None
        variant = _variant(call, function, system)
        release = release_of(system.distributions, file.path, file.settings.python)
        judged = _judge(system, function, variant, release)
        if judged is None:
            return None
        related: tuple[Related, ...] = ()
        if release is not None and release.path is not None:
            place = Location(release.path, release.line, 1, release.line, 1)
            related = (Related(place, f"{release.distribution} is named here"),)
        limits = [word for word, _ in call.keywords if _LIMITS.match(word)]
        notes = [_NOTES[system.name]] if system.name in _NOTES else []
        if limits:
            notes = [f"the {limits[0]} of this call may end a run first, or hide it"]
        message = "; ".join(
            [f"{function} {judged.what}", *notes, _remedy(system, release, function)]
        )
        return Finding(
            self.code,
            file.location(call.span),
            judged.certainty,
            message,
            expression=" ".join(file.text.at(call.span).split()),
            related=related,
            no_fix="the fault is in the library",
        )


@dataclass(frozen=True, slots=True)
class _Judged:
    what: str
    certainty: Certainty


def _judge(
    system: System, function: str, variant: str | None, release: "Release | None"
) -> _Judged | None:
    """Say what is known of a call, or None where nothing speaks against it."""
    from ransac_fix.scan.releases import within
    from ransac_fix.verdicts import nearest_releases, verdicts_for

    distribution = release.distribution if release is not None else system.distributions[0]
    every = _of_variant(verdicts_for(distribution, None, function), variant)
    bad = [one for one in every if one.verdict == "undersamples"]
    if not bad:
        return None
    if release is None:
        if len({one.version for one in every}) != len({one.version for one in bad}):
            return None
        releases = _listed(one.version for one in bad)
        return _Judged(
            f"undersamples in every release of {distribution} measured ({releases})", "low"
        )
    if release.version is not None:
        own = [one for one in every if _same(one.version, release.version)]
        wrong = [one for one in own if one.verdict == "undersamples"]
        if wrong:
            one = wrong[0]
            sure: Certainty = "medium" if len(wrong) == len(own) else "low"
            stops = f", where it stops by {one.formula}" if one.formula else ""
            what = f"undersamples in {distribution} {release.version}{stops}"
            return _Judged(f"{what} (measured {one.measured_on})", sure)
        if own:
            return None
        near = {one for one in nearest_releases(distribution, release.version, function) if one}
        if not near & {one.version for one in bad}:
            return None
        measured = _listed(one.version for one in bad)
        what = (
            f"was not measured in {distribution} {release.version}; it undersamples in {measured}"
        )
        return _Judged(what, "low")
    inside = set(within({one.version for one in every}, release.range or ""))
    if not inside:
        return None
    wrong_in = {one.version for one in bad} & inside
    if not wrong_in:
        return None
    wanted = f"{distribution}{release.range or ''}"
    if wrong_in == inside:
        what = f"undersamples in every release of {wanted} that was measured ({_listed(inside)})"
        return _Judged(what, "medium")
    what = f"undersamples in some releases of {wanted} ({_listed(wrong_in)}), not in others"
    return _Judged(f"{what} ({_listed(inside - wrong_in)})", "low")


def _of_variant(verdicts: "Iterable[StoredVerdict]", variant: str | None) -> "list[StoredVerdict]":
    known = [one for one in verdicts if one.verdict != "not measured"]
    if variant is None:
        return known
    return [one for one in known if one.entry_point.partition("(")[2].rstrip(")") == variant]


def _same(one: str, other: str) -> bool:
    from ransac_fix.scan.releases import within

    return bool(within([one], f"=={other}"))


def _listed(versions: Iterable[str]) -> str:
    from packaging.version import Version

    return ", ".join(sorted(set(versions), key=Version))


def _remedy(system: System, release: "Release | None", function: str) -> str:
    from ransac_fix.verdicts import fixed_release

    # Of a release that is not known, any may be in use.
    version = "0" if release is None or release.version is None else release.version
    better = fixed_release(system.distributions[0], version, function)
    if better is not None:
        return f"upgrade to {better}"
    if system.name in _patched():
        return f'run the program with `ransac-fix run`, or call `ransac_fix.patch("{system.name}")`'
    return "raise the confidence, or the least number of trials"


@cache
def _patched() -> frozenset[str]:
    from importlib.metadata import entry_points

    return frozenset(entry_points(group="ransac_fix.patches").names)


@cache
def _functions() -> dict[str, frozenset[str]]:
    from ransac_fix.verdicts import load_verdicts

    found: dict[str, set[str]] = {}
    for one in load_verdicts():
        if one.verdict == "undersamples":
            found.setdefault(one.system, set()).add(one.function)
    return {name: frozenset(functions) for name, functions in found.items()}


@cache
def _gates() -> tuple[tuple[bytes, tuple[bytes, ...]], ...]:
    functions = _functions()
    return tuple(
        (module.lower().encode(), tuple(name.lower().encode() for name in functions[system.name]))
        for system in load_systems()
        if system.name in functions
        for module in system.modules
    )


def _system(path: str) -> System | None:
    """Find the system that a dotted path leads into, where it was measured to undersample."""
    module, _, rest = path.partition(".")
    for system in load_systems():
        functions = _functions().get(system.name, frozenset())
        if module in system.modules and rest.rpartition(".")[2] in functions:
            return system
    return None


def _bound(body: tuple[Stmt, ...]) -> dict[str, str]:
    """Say what modules and members the names of a file stand for."""
    bound: dict[str, str] = {}
    for stmt in statements(body, definitions=True):
        match stmt:
            case Import(name=name, target=target):
                bound[name] = target
            case Assign(target=str() as name, value=Name(name=value)):
                head, _, tail = value.partition(".")
                if tail and head in bound:
                    bound[name] = f"{bound[head]}.{tail}"
            case _:
                pass
    return bound


def _resolved(call: Call, bound: dict[str, str]) -> str:
    if call.base is None:
        return bound.get(call.name, "")
    if not isinstance(call.base, Name):
        return ""
    head, _, tail = call.base.name.partition(".")
    if head not in bound:
        return ""
    return ".".join(part for part in (bound[head], tail, call.name) if part)


def _is_asked_for(call: Call, system: System) -> bool:
    """Whether a call gives the confidence that the library does not have by default."""
    wanted = _ASKED_FOR.get(system.name)
    if wanted is None:
        return True
    keyword, place = wanted
    given = dict(call.keywords).get(keyword)
    if given is None and len(call.args) > place:
        given = call.args[place]
    return given is not None and not (isinstance(given, Num) and given.value == 1.0)


def _variant(call: Call, function: str, system: System) -> str | None:
    """Read the method that a call of OpenCV chooses; None where it is not known, or no matter."""
    if system.name != "opencv":
        return None
    for argument in (*call.args, *(value for _, value in call.keywords)):
        if isinstance(argument, Name):
            method = _METHOD.match(argument.name.rpartition(".")[2])
            if method:
                return method[1].upper()
    default = _DEFAULT_METHOD.get(function)
    if default is None or _has_method(call, function):
        return None
    return default


def _has_method(call: Call, function: str) -> bool:
    place = 2 if function in ("findHomography", "findFundamentalMat") else 3
    given: list[Expr] = [value for word, value in call.keywords if word == "method"]
    return bool(given) or len(call.args) > place

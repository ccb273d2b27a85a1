"""Apply patches, undo them, and say what is in force.

Each system has a `_System`: its patch, its switch, and what was found when its library was
looked at. Library code is called (to look at it) and waited for (while it is being imported)
without holding the lock; replacing attributes and flipping switches is done with it.
"""

import importlib.util
import os
import sys
import threading
import warnings
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from types import ModuleType, TracebackType
from typing import TYPE_CHECKING, Self

from packaging.requirements import Requirement
from packaging.version import InvalidVersion

from ransac_fix.errors import PatchNotApplicable, RansacFixError, RansacFixWarning
from ransac_fix.patching import finder, missing, plugins, registry, startup
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.state import PatchingStatus, State, SystemStatus
from ransac_fix.patching.switch import Scope, Switch

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "exactly",
    "imported",
    "installable",
    "observable",
    "observe",
    "patch",
    "patched",
    "place",
    "planned",
    "share_with_workers",
    "status",
    "unpatch",
]

_LOCK = threading.RLock()


class _System:
    """One system: its patch, whether it is in use, and what is known of the imported library."""

    def __init__(self, patch: LibraryPatch) -> None:
        self.patch = patch
        self.name = patch.system
        self.switch = Switch(patch.system)
        # The plan of each module looked at, with the module: an import may bring another one.
        self.plans: dict[str, tuple[ModuleType, tuple[Replacement, ...]]] = {}
        self.refusal: str | None = None
        # What a trace asks to be told of: a module of the library that has been imported.
        self.observer: Callable[[_System, ModuleType], None] | None = None

    def look(self) -> None:
        """Make plans for the modules that are imported.

        Raises
        ------
        PatchNotApplicable
            When one of them is not of a known shape.
        """
        for name in self.patch.modules:
            finder.wait_for_import(name)
            module = sys.modules.get(name)
            if module is None or self.plan_holds(name):
                continue
            if finder.is_half_imported(module):
                # This is called from its import: too early to judge it.
                finder.watch_half_imported(name, imported)
            else:
                self.plan(module)
        if self.refusal is not None:
            raise PatchNotApplicable(self.refusal_line)

    def plan(self, module: ModuleType) -> None:
        """Look at one imported module; keep the plan, or the reason why there is none."""
        name = module.__name__
        try:
            plan = self.patch.plan(module)
            for replacement in plan:
                if replacement.name not in vars(replacement.holder):
                    raise PatchNotApplicable(f"{replacement.holder} has no {replacement.name}")
        except PatchNotApplicable as error:
            self.plans.pop(name, None)
            self.refusal = str(error)
        except (Exception, SystemExit) as error:  # noqa: BLE001 -- may be a stranger's code
            self.plans.pop(name, None)
            self.refusal = f"its patch failed with {type(error).__name__}: {error}"
        else:
            self.plans[name] = module, plan
            self.refusal = None

    def plan_holds(self, name: str) -> bool:
        """Return whether a module's plan is for the functions that are there now."""
        module, plan = self.plans.get(name, (None, ()))
        if module is not sys.modules.get(name) or self.refusal is not None:
            return False
        known = {(id(place.holder), place.name): place for place in registry.places(self.name)}
        for replacement in plan:
            place = known.get((id(replacement.holder), replacement.name))
            current = vars(replacement.holder).get(replacement.name)
            if place is None or not (place.installed or place.original is current):
                return False
        return True

    def settle(self, *, copies: bool = True) -> None:
        """Put in place what is to be in place. Called with the lock."""
        if not self.switch.in_use:
            registry.remove(self.name, copies=copies)
            if self.observer is None:
                finder.unwatch(self.patch.modules)
            else:
                finder.watch(self.patch.modules, imported)
            return
        finder.watch(self.patch.modules, imported)
        for _, plan in self.plans.values():
            registry.install(self.name, self.switch, plan, copies=copies)

    @property
    def is_installed(self) -> bool:
        return any(_is_findable(name) for name in plugins.imports(self.patch))

    @property
    def is_imported(self) -> bool:
        return any(name in sys.modules for name in self.patch.modules)

    @property
    def version(self) -> str | None:
        for name in plugins.imports(self.patch):
            found = getattr(sys.modules.get(name), "__version__", None)
            if isinstance(found, str):
                return found
        for name in plugins.distributions(self.patch):
            try:
                return distribution_version(name)
            except PackageNotFoundError:
                continue
        return None

    @property
    def refusal_line(self) -> str:
        return f"{self.name} {self.version or '(unknown version)'} is left as it is: {self.refusal}"

    @property
    def is_exact(self) -> bool:
        return bool(self.plans) and not any(plan for _, plan in self.plans.values())

    def is_checked(self, version: str | None) -> bool:
        if version is None:
            return False
        try:
            return any(
                Requirement(text).specifier.contains(version, prereleases=True)
                for text in self.patch.requirements
            )
        except InvalidVersion:  # a build of one's own
            return False

    def status(self) -> SystemStatus:
        switch = self.switch
        version = self.version
        checked = self.is_checked(version)
        sites = tuple(place.site for place in registry.places(self.name) if place.installed)
        state: State
        reason = ""
        if startup.off():
            state, reason = "switched off", "RANSAC_FIX=0 is set"
        elif not self.is_imported:
            if not self.is_installed:
                state = "not installed"
            else:
                state = "waiting" if switch.in_use else "off"
        elif self.refusal is not None:
            state, reason = "refused", self.refusal
        elif self.is_exact:
            state, reason = "already exact", "nothing is changed"
        elif switch.in_use and sites:
            state = "patched"
            if not checked:
                reason = (
                    f"the patch was tried on {' and '.join(self.patch.requirements)}; this release"
                    " has the same shape and gives the same values"
                )
        else:
            state = "waiting" if switch.in_use else "off"
        return SystemStatus(
            system=self.name,
            state=state,
            reason=reason,
            version=version,
            checked=checked,
            sites=sites,
            process_wide=state == "patched" and switch.everywhere,
            here=state == "patched" and switch.active(),
            scopes=switch.scopes,
        )


_SYSTEMS: dict[str, _System] = {}


def patch(*names: str, slack: float | None = None) -> None:
    """Make libraries exact in the whole process, until `unpatch`.

    May be called before or after the libraries are imported, and any number of times. Where a
    library is not imported yet it is patched when it is.

    Parameters
    ----------
    *names : str
        System, distribution or import names, such as ``"scikit-learn"`` or ``"sklearn"``. None:
        everything installed for which there is a patch.
    slack : float, optional
        For wrapped compiled libraries, all of them: the relative excess of failure probability
        that is accepted without drawing the missing trials; 0 for the exact number. Stays as it
        is where not given: 0.1 at first, or what ``RANSAC_FIX_SLACK`` says.

    Raises
    ------
    PatchNotApplicable
        If a named library is imported and is not of a shape the patch knows; nothing is changed
        then. In a library imported later, or not named, the same is a `RansacFixWarning` and an
        entry in `status`.
    RansacFixError
        If there is no patch of that name, or the library is not installed; if `slack` is
        negative.
    """
    systems = _ready(names)
    if slack is not None:
        missing.set_slack(slack)
    with _LOCK:
        for system in systems:
            system.switch.ask(True)
            system.settle()
    _look_again(systems)
    _publish()


def unpatch(*names: str) -> None:
    """Undo `patch`: put the originals back.

    Blocks of `patched` and drop-in calls that are under way elsewhere stay exact until they end.
    Where other code has wrapped a patched function, the function stays and passes calls on.

    Parameters
    ----------
    *names : str
        As for `patch`. None: everything.

    Raises
    ------
    RansacFixError
        If there is no patch of that name.
    """
    systems = _select(names)
    with _LOCK:
        for system in systems:
            system.switch.ask(False)
            system.settle()
    _publish()


def patched(*names: str, threads: bool = False) -> "_Patched":
    """Return a context manager in whose block libraries are exact.

    Parameters
    ----------
    *names : str
        As for `patch`.
    threads : bool, default False
        False: in this thread, or this async task and those started from it. True: in all threads
        of the process. Neither reaches joblib or multiprocessing workers (see `status`).

    Returns
    -------
    context manager
        Entering it raises what `patch` raises.
    """
    return _Patched(names, threads)


def status() -> PatchingStatus:
    """Return what is patched, what is not and why, and who inherits it."""
    plugins_found = plugins.discover()
    systems = [_system(patch) for patch in plugins_found.patches.values()]
    _look_again([system for system in systems if system.switch.in_use])
    found = {system.name: system.status() for system in systems}
    for name, reason in plugins_found.broken.items():
        found.setdefault(name, _broken(name, reason))
    return PatchingStatus(
        systems=tuple(found[name] for name in sorted(found)),
        worker_processes=startup.is_inherited() or startup.is_enabled_for_site(),
    )


class _Patched:
    """The context manager of `patched`. It may be entered again, and nested."""

    __slots__ = ("_entered", "_names", "_threads")

    def __init__(self, names: tuple[str, ...], threads: bool) -> None:
        self._names = names
        self._threads = threads
        self._entered: list[list[tuple[_System, Scope | None]]] = []

    def __enter__(self) -> Self:
        systems = _ready(self._names)
        with _LOCK:
            self._entered.append([(system, _enter(system, self._threads)) for system in systems])
        _look_again(systems)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with _LOCK:
            for system, scope in self._entered.pop():
                _leave(system, scope)


class exactly:  # noqa: N801 -- read as a word: `with exactly(PATCH):`
    """What a drop-in enters for one call: one library, exact in this thread or task.

    Parameters
    ----------
    library : LibraryPatch
        Its patch.

    Raises
    ------
    PatchNotApplicable
        On entry, if the imported library is not of a shape the patch knows.
    """

    __slots__ = ("_scope", "_system")

    def __init__(self, library: LibraryPatch) -> None:
        self._system = _system(library)
        self._scope: Scope | None = None

    def __enter__(self) -> None:
        if startup.off():
            return
        self._system.look()
        with _LOCK:
            self._scope = self._system.switch.enter_here()
            self._system.settle(copies=False)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._scope is not None:
            with _LOCK:
                self._system.switch.leave_here(self._scope)
                self._system.settle(copies=False)


def planned(library: LibraryPatch) -> tuple[Replacement, ...]:
    """Return what a drop-in has to make exact in an imported library: nothing if it is already.

    Nothing either where ``RANSAC_FIX=0`` is set. The originals in the plan are the library's own,
    also while it is patched.

    Raises
    ------
    PatchNotApplicable
        If the library is not of a shape the patch knows.
    """
    if startup.off():
        return ()
    system = _system(library)
    system.look()
    return tuple(replacement for _, plan in system.plans.values() for replacement in plan)


def imported(module: ModuleType) -> None:
    """Patch a library that has just been imported. Never raises: the user's import goes on."""
    for system in list(_SYSTEMS.values()):
        if module.__name__ not in system.patch.modules:
            continue
        observer = system.observer
        if system.switch.in_use or observer is not None:
            if not system.plan_holds(module.__name__):
                system.plan(module)
            with _LOCK:
                system.settle()
            if system.refusal is not None and system.switch.in_use:
                _warn(system.refusal_line)
        if observer is not None:
            observer(system, module)


def observable() -> list[_System]:
    """Return the systems whose calls a trace can watch."""
    return [system for system in _select(()) if system.patch.observe is not None]


def observe(system: _System, observer: "Callable[[_System, ModuleType], None] | None") -> None:
    """Tell `observer` of modules of a library when they have been imported; None: no more."""
    with _LOCK:
        system.observer = observer
        system.settle()


def place(system: _System, put: "Callable[[], None]") -> None:
    """Call `put`, which replaces functions that may be, or become, patched.

    The stand-ins go in first, in force or not: what comes on top of them is left in place when
    the patch is asked for or undone.
    """
    with _LOCK:
        for _, plan in system.plans.values():
            registry.install(system.name, system.switch, plan, copies=True)
        put()


def share_with_workers() -> None:
    """Let processes that are started from now on patch what `patch` has patched here."""
    asked = [system for system in list(_SYSTEMS.values()) if system.switch.asked]
    startup.environment(os.environ, {system.name: system.patch.modules for system in asked})


def installable() -> dict[str, tuple[str, ...]]:
    """Return every installed system that has a patch, as `startup.environment` takes them."""
    systems = [system for system in _select(()) if system.is_installed]
    for name, reason in plugins.discover().broken.items():
        _warn(f"the patch {name} is left out: {reason}")
    return {system.name: system.patch.modules for system in systems}


def _ready(names: tuple[str, ...]) -> list[_System]:
    """Return the systems asked for, looked at as far as they are imported."""
    systems = _select(names)
    if startup.off():
        return []
    if not names:
        systems = [system for system in systems if system.is_imported or system.is_installed]
        for system in systems:
            if not _try(system):
                _warn(system.refusal_line)
        for name, reason in plugins.discover().broken.items():
            _warn(f"the patch {name} is left out: {reason}")
        return systems
    for system in systems:
        if not (system.is_imported or system.is_installed):
            raise RansacFixError(f"{system.name} is not installed here: there is nothing to patch")
    refusals = [system.refusal_line for system in systems if not _try(system)]
    if refusals:
        raise PatchNotApplicable("; ".join(refusals))
    return systems


def _look_again(systems: list[_System]) -> None:
    """Catch libraries whose import began before the hook was there to see it."""
    for system in systems:
        known = system.refusal
        if _try(system):
            with _LOCK:
                system.settle()
        elif system.refusal != known:
            _warn(system.refusal_line)


def _try(system: _System) -> bool:
    try:
        system.look()
    except PatchNotApplicable:
        return False
    return True


def _enter(system: _System, threads: bool) -> Scope | None:
    scope = None if threads else system.switch.enter_here()
    if scope is None:
        system.switch.enter_process()
    system.settle()
    return scope


def _leave(system: _System, scope: Scope | None) -> None:
    if scope is None:
        system.switch.leave_process()
    else:
        system.switch.leave_here(scope)
    system.settle()


def _system(library: LibraryPatch) -> _System:
    return _SYSTEMS.setdefault(library.system, _System(library))


def _select(names: tuple[str, ...]) -> list[_System]:
    """Return the systems of the given names, or all."""
    found = plugins.discover()
    wanted = dict.fromkeys(map(plugins.resolve, names)) if names else found.patches
    for name in wanted:
        if name not in found.patches:
            raise PatchNotApplicable(f"the patch {name} is broken: {found.broken[name]}")
    return [_system(found.patches[name]) for name in wanted]


def _publish() -> None:
    """Keep what worker processes inherit in step with what is asked here."""
    if startup.is_inherited():
        share_with_workers()


def _broken(name: str, reason: str) -> SystemStatus:
    return SystemStatus(name, "broken", reason, None, False, (), False, False, 0)


def _is_findable(name: str) -> bool:
    if name in sys.modules:
        return True
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        return False


def _warn(message: str) -> None:
    try:
        warnings.warn(message, RansacFixWarning, stacklevel=3)
    except RansacFixWarning:  # -W error: still no exception in the user's import
        print(f"ransac-fix: warning: {message}", file=sys.stderr)


def _adopt() -> None:
    """Take over from `startup` in a process that was started to be patched."""
    if startup.off():
        return
    found = plugins.discover().patches
    for name in startup.watched():
        if name in found:
            system = _system(found[name])
            system.switch.ask(True)
            system.settle()
    if startup.trace_folder():
        from ransac_fix.patching import tracing

        tracing.adopt()


def _after_fork() -> None:
    global _LOCK  # another thread of the parent may have held it
    _LOCK = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
_adopt()

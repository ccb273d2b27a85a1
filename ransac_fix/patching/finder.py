"""The import hook: calls back right after a watched module has been imported.

A meta-path finder asks the other finders for the module, and hands the import system their
answer with a loader that takes itself out before it runs the module: nothing of it can be seen
in ``module.__loader__`` or ``module.__spec__``. Next to nothing is imported, for every worker
process pays for this module at its start.
"""

from __future__ import annotations

import sys
from _thread import get_ident
from types import ModuleType

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes too long to import
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from importlib.machinery import ModuleSpec
    from typing import Any, TypeAlias

    Callback: TypeAlias = Callable[[ModuleType], None]

__all__ = ["is_half_imported", "unwatch", "wait_for_import", "watch", "watch_half_imported"]

_watched: dict[str, Callback] = {}
# Finders may look a name up again while they look it up: (thread, name) being looked up.
_looking_up: set[tuple[int, str]] = set()
# Modules whose import had begun before they were watched, and is still going on.
_half: dict[str, Callback] = {}


def watch(names: Iterable[str], callback: Callback) -> None:
    """Call `callback` with each of the named modules right after it is imported or reloaded.

    The callback runs under the module's import lock, before any other thread can see the module
    as imported. It must not raise.
    """
    for name in names:
        _watched[name] = callback
    if _watched and _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)


def unwatch(names: Iterable[str]) -> None:
    """Forget the named modules."""
    for name in names:
        _watched.pop(name, None)
    if not _watched and _FINDER in sys.meta_path:
        sys.meta_path.remove(_FINDER)


def wait_for_import(name: str) -> None:
    """Return once no other thread is in the middle of importing the named module.

    The import system's own lock is taken, and with it its protection against deadlock: where two
    threads wait for each other's import, or this thread is itself importing the module, it
    returns at once.
    """
    bootstrap = sys.modules["_frozen_importlib"]
    # The function the interpreter calls itself when `import x` meets a module in the making.
    wait: Callable[[str], None] | None = getattr(bootstrap, "_lock_unlock_module", None)
    if wait is not None:
        wait(name)


def is_half_imported(module: ModuleType) -> bool:
    """Return whether a module is in the middle of being imported."""
    return bool(getattr(getattr(module, "__spec__", None), "_initializing", False))


def watch_half_imported(name: str, callback: Callback) -> None:
    """Call `callback` with a module that is being imported, once that is done.

    Nothing tells when it is: the module is looked at whenever another import begins.
    """
    _half[name] = callback


def _look_at_half_imported() -> None:
    for name in list(_half):
        module = sys.modules.get(name)
        if module is not None and is_half_imported(module):
            continue
        callback = _half.pop(name, None)
        if callback is not None and module is not None:
            callback(module)


class _Finder:
    """The meta-path finder. One instance, there while anything is watched."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if _half:
            _look_at_half_imported()
        if fullname not in _watched:
            return None
        key = get_ident(), fullname
        if key in _looking_up:
            return None
        _looking_up.add(key)
        try:
            for finder in list(sys.meta_path):
                find_spec = getattr(finder, "find_spec", None)
                if finder is self or find_spec is None:
                    continue
                spec: ModuleSpec | None = find_spec(fullname, path, target)
                if spec is not None:
                    if hasattr(spec.loader, "exec_module"):
                        spec.loader = _Loader(spec.loader)  # type: ignore[assignment]
                    return spec
            return None
        finally:
            _looking_up.discard(key)


class _Loader:
    """A loader that puts the real one back, runs it, and then calls back."""

    def __init__(self, loader: Any) -> None:
        self._loader = loader

    def __getattr__(self, name: str) -> object:
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        module: ModuleType | None = self._loader.create_module(spec)
        return module

    def exec_module(self, module: ModuleType) -> None:
        spec: Any = module.__spec__
        if spec is not None and spec.loader is self:
            spec.loader = self._loader
        if getattr(module, "__loader__", None) is self:
            module.__loader__ = self._loader
        self._loader.exec_module(module)
        callback = _watched.get(module.__name__)
        if callback is not None:
            # A module may put another object in its own place while it runs.
            imported = sys.modules.get(module.__name__, module)
            callback(imported if isinstance(imported, ModuleType) else module)


_FINDER: Any = _Finder()

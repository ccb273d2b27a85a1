"""The one registry of originals: what was replaced, where, and by what.

Stand-ins pass calls on while they are not asked to be exact, so taking one away is tidiness,
not correctness; where other code has wrapped a stand-in it is left, and nothing is lost.
All functions here are called under the engine's lock.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from ransac_fix.patching.interface import Replacement
from ransac_fix.patching.switch import Switch, stand_in

__all__ = ["Place", "install", "places", "put", "remove"]


@dataclass(frozen=True, slots=True)
class Place:
    """One replaced attribute. `original` and `replaced` are as found in the holder's dict."""

    system: str
    holder: ModuleType | type
    name: str
    original: Any
    replaced: Any

    @property
    def site(self) -> str:
        """The attribute's full name, such as ``sklearn.linear_model._ransac.f``."""
        if isinstance(self.holder, ModuleType):
            return f"{self.holder.__name__}.{self.name}"
        return f"{self.holder.__module__}.{self.holder.__qualname__}.{self.name}"

    @property
    def installed(self) -> bool:
        """Whether the stand-in is what the library finds there now, wrapped or not."""
        return _is_covered(vars(self.holder).get(self.name), self.replaced)


_PLACES: dict[tuple[int, str], Place] = {}  # keyed by the holder's id; the place keeps the holder
# Where copies of a place's original or stand-in were found, and among how many modules.
_COPIES: dict[tuple[int, str], tuple[int, list[dict[str, Any]]]] = {}


def install(
    system: str, switch: Switch, replacements: tuple[Replacement, ...], *, copies: bool
) -> None:
    """Put the stand-ins in place. What stands already is left as it is.

    With `copies`, every module that has a copy of the original under its name (a ``from x import
    y``) gets the stand-in too. That means a look at all modules, a millisecond or so whenever
    there are new ones; the library's own loop does not need it.
    """
    for replacement in replacements:
        holder, name = replacement.holder, replacement.name
        current = vars(holder)[name]
        place = _PLACES.get((id(holder), name))
        if place is not None and _is_covered(current, place.replaced):
            continue
        if place is None or place.original is not current:
            place = _place(system, switch, replacement, current)
            _PLACES[id(holder), name] = place
        put(place, place.original, place.replaced, copies=copies)


def remove(system: str, *, copies: bool) -> None:
    """Put the originals of one system back, except where other code has wrapped the stand-in."""
    for place in places(system):
        current = vars(place.holder).get(place.name)
        if current is place.replaced:
            put(place, place.replaced, place.original, copies=copies)
        elif current is not place.original and not place.installed:
            # The library was reloaded, or someone else's function is there.
            _PLACES.pop((id(place.holder), place.name), None)


def places(system: str) -> tuple[Place, ...]:
    """Return the places of one system, in the order they were first replaced."""
    return tuple(place for place in _PLACES.values() if place.system == system)


def _place(system: str, switch: Switch, replacement: Replacement, current: Any) -> Place:
    if isinstance(current, staticmethod | classmethod):
        kind = type(current)
        replaced: Any = kind(stand_in(current.__func__, replacement.exact, switch))
    else:
        replaced = stand_in(current, replacement.exact, switch)
    return Place(system, replacement.holder, replacement.name, current, replaced)


def put(place: Place, old: Any, new: Any, *, copies: bool) -> None:
    """Replace one by the other in a place, and with `copies` in modules that imported it."""
    setattr(place.holder, place.name, new)
    if not copies or not isinstance(place.holder, ModuleType):
        return
    key = id(place.holder), place.name
    modules, namespaces = _COPIES.get(key, (0, []))
    if modules != len(sys.modules):
        namespaces = [
            namespace
            for namespace in _namespaces()
            if place.name in namespace
            and (namespace[place.name] is old or namespace[place.name] is new)
        ]
        _COPIES[key] = len(sys.modules), namespaces
    for namespace in namespaces:
        if namespace.get(place.name) is old:
            namespace[place.name] = new


def _namespaces() -> Iterator[dict[str, Any]]:
    # Not `module.__dict__`: that would make a lazily loaded module load itself.
    namespace_of: Any = vars(ModuleType)["__dict__"].__get__
    for module in list(sys.modules.values()):
        if isinstance(module, ModuleType):
            yield namespace_of(module)


def _is_covered(current: Any, replaced: Any) -> bool:
    """Return whether `current` is the stand-in, or a well-behaved wrapper around it."""
    inner = getattr(replaced, "__func__", replaced)
    current = getattr(current, "__func__", current)
    for _ in range(100):
        if current is inner:
            return True
        current = getattr(current, "__wrapped__", None)
        if current is None:
            return False
    return False

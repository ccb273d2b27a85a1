"""Where and when a system is exact: everywhere, or in one thread or async task.

A stand-in asks its `Switch` on every call, so the question must be cheap: one attribute and one
context variable. A scope ends for everybody at once: an async task started inside ``with
patched():`` inherits the scope, and loses it when the block ends.
"""

import functools
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

__all__ = ["Scope", "Switch", "stand_in"]


class Scope:
    """One entered ``with patched():`` block or drop-in call."""

    __slots__ = ("live", "outer")

    def __init__(self, outer: "Scope | None") -> None:
        self.live = True
        self.outer = outer


class Switch:
    """Says whether one system is to be exact, here and now.

    Attributes
    ----------
    asked : bool
        `patch` is in force.
    process_scopes, scopes : int
        Blocks in force for the whole process, and for single threads or tasks.
    everywhere : bool
        ``asked or process_scopes > 0``, kept ready for the stand-ins.
    innermost : callable
        Returns the scope last entered in this thread or task, in force or not.

    Everything but `active` and `leave_here` is called under the engine's lock.
    """

    __slots__ = ("_here", "asked", "everywhere", "innermost", "process_scopes", "scopes")

    def __init__(self, system: str) -> None:
        self.asked = False
        self.process_scopes = 0
        self.scopes = 0
        self.everywhere = False
        self._here: ContextVar[Scope | None] = ContextVar(f"ransac_fix {system}", default=None)
        self.innermost: Callable[[], Scope | None] = self._here.get

    @property
    def in_use(self) -> bool:
        """Whether any call anywhere is to be exact."""
        return self.everywhere or self.scopes > 0

    def active(self) -> bool:
        """Return whether a call made here and now is to be exact."""
        return self.everywhere or self.active_here()

    def active_here(self) -> bool:
        """Return whether a scope of this thread or task is in force."""
        scope = self._here.get()
        while scope is not None:
            if scope.live:
                return True
            scope = scope.outer
        return False

    def ask(self, asked: bool) -> None:
        """Set or clear what `patch` asks for."""
        self.asked = asked
        self.everywhere = self.asked or self.process_scopes > 0

    def enter_process(self) -> None:
        """Begin a block that holds in all threads."""
        self.process_scopes += 1
        self.everywhere = True

    def leave_process(self) -> None:
        """End a block that holds in all threads."""
        self.process_scopes -= 1
        self.everywhere = self.asked or self.process_scopes > 0

    def enter_here(self) -> Scope:
        """Begin a block of this thread or task."""
        scope = Scope(self._innermost())
        self._here.set(scope)
        self.scopes += 1
        return scope

    def leave_here(self, scope: Scope) -> None:
        """End a block, for every task that inherited it."""
        # No token is reset: blocks may be left in another order, or another context (a
        # generator, a fixture), than they were entered in.
        scope.live = False
        self._here.set(self._innermost())
        self.scopes -= 1

    def _innermost(self) -> Scope | None:
        scope = self._here.get()
        while scope is not None and not scope.live:
            scope = scope.outer
        return scope


def stand_in(
    original: Callable[..., Any], exact: Callable[..., Any], switch: Switch
) -> Callable[..., Any]:
    """Return a function in the likeness of `original` that calls `exact` while the switch is on."""
    # Most calls are made where no block was ever entered: one look at the context variable.
    innermost, active_here = switch.innermost, switch.active_here

    @functools.wraps(original)
    def call(*args: Any, **kwargs: Any) -> Any:
        if switch.everywhere or (innermost() is not None and active_here()):
            return exact(*args, **kwargs)
        return original(*args, **kwargs)

    call.__ransac_fix__ = True  # type: ignore[attr-defined]
    return call

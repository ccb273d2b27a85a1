"""Numba with types kept."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

_P = ParamSpec("_P")
_R = TypeVar("_R")


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function to machine code that releases the interpreter, and keep it on disk.

    Division by zero gives infinity, as in NumPy. Additions are not reordered, so results do not
    depend on the machine's vector width.
    """
    return cast(
        "Callable[_P, _R]", numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    )

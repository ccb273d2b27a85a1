"""Read the parameters of a compiled function from the signature in its docstring."""

import ast
import re
from collections.abc import Callable
from typing import Any

__all__ = ["documented_parameters"]

# ``name: type = default``; a type has brackets with commas in them, but no colon.
_PARAMETER = re.compile(r"(?:\(|, )(\w+): ")


def documented_parameters(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the parameters of a function that pybind11 made, in order, with their defaults.

    Parameters
    ----------
    function : callable
        Its docstring begins with ``name(parameter: type = default, ...) -> type``.

    Returns
    -------
    dict
        Default values by name; ``...`` for a parameter that has none. Empty where the docstring
        is another.
    """
    signature = (function.__doc__ or "").lstrip().partition("\n")[0].rpartition(") -> ")[0]
    found = list(_PARAMETER.finditer(signature))
    ends = [match.start() for match in found] + [len(signature)]
    parameters: dict[str, Any] = {}
    for match, end in zip(found, ends[1:], strict=True):
        _, equals, default = signature[match.end() : end].rpartition(" = ")
        try:
            parameters[match[1]] = ast.literal_eval(default) if equals else ...
        except (ValueError, SyntaxError):  # an object: its text is no value
            parameters[match[1]] = ...
    return parameters

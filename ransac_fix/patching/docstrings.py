"""Read the parameters of compiled functions from the signatures in their docstrings."""

import ast
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType
from typing import Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.missing import own_function

__all__ = ["documented_functions", "documented_parameters"]

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


def documented_functions(
    module: ModuleType, release: str, functions: Mapping[str, Iterable[str]]
) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Return functions of a module that is named as its distribution, and their parameters.

    Parameters
    ----------
    module : module
        The library.
    release : str
        The one release that is known.
    functions : mapping of str to iterable of str
        Names of functions, with the parameters that each must have.

    Returns
    -------
    dict
        The function as it is without patches, and its `documented_parameters`, by name.

    Raises
    ------
    PatchNotApplicable
        If the release is another, or a function or a parameter is missing.
    """
    library = module.__name__
    try:
        found = version(library)
    except PackageNotFoundError:
        found = "unknown"
    if found != release:
        raise PatchNotApplicable(f"the rule of release {found} was not measured")
    documented = {}
    for name, needed in functions.items():
        original = own_function(module, name)
        if original is None:
            raise PatchNotApplicable(f"{library} has no {name}")
        parameters = documented_parameters(original)
        missing = [parameter for parameter in needed if parameter not in parameters]
        if missing:
            raise PatchNotApplicable(f"{library}.{name} takes no {missing[0]}")
        documented[name] = original, parameters
    return documented

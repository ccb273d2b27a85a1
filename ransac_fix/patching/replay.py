"""Make kept calls again with the exact rule: a program of its own, ``python -m``.

    python -m ransac_fix.patching.replay RESULTS FILE ...

It runs beside the traced program's end, in a process that may crash or be ended, and writes one
JSON line to RESULTS when it begins a call and one when it is done. A wrapped library runs as it is
first and goes on to the exact number; a library whose rule is replaced runs twice on the same
random numbers, with its own rule and with the exact one.
"""

import contextlib
import importlib
import json
import pickle
import random
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from zlib import crc32

from ransac_fix.patching import engine, missing, plugins
from ransac_fix.patching.samples import kept
from ransac_fix.patching.watching import Watched, watching

if TYPE_CHECKING:
    from ransac_fix.patching.watching import Facts

__all__ = ["main", "replay"]


def replay(system: str, function: str, inputs: bytes, seed: int) -> "tuple[Facts, Facts]":
    """Make one call again.

    Parameters
    ----------
    system, function : str
        As a trace names them.
    inputs : bytes
        Its pickled arguments.
    seed : int
        Takes the place of what the program had not seeded.

    Returns
    -------
    tuple of tuple
        The numbers of the run with the library's own rule, and with the exact one: see
        `ransac_fix.patching.watching.note`.

    Raises
    ------
    LookupError
        If there is no such function here, or the run said nothing of itself.
    """
    patch = plugins.discover().patches[system]
    for name in patch.modules:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    call = _function(patch, function)
    if patch.wraps:
        return _run(call, inputs, seed, exact=True)
    _, own = _run(call, inputs, seed, exact=False)
    with engine.patched(system):
        _, exact = _run(call, inputs, seed, exact=True)
    return own, exact


def _function(patch: Any, function: str) -> Callable[..., Any]:
    for name in patch.modules:
        module = sys.modules.get(name)
        if module is None:
            continue
        for found in patch.observe(module):
            label = found.name
            if not isinstance(found.holder, ModuleType):
                label = f"{found.holder.__qualname__}.{label}"
            if label == function:
                call: Callable[..., Any] = found.exact
                return call
    raise LookupError(f"there is no {function}")


def _run(
    call: Callable[..., Any], inputs: bytes, seed: int, *, exact: bool
) -> "tuple[Facts, Facts]":
    """Return the numbers of a run when it first said some, and at its end."""
    args, kwargs = pickle.loads(inputs)  # noqa: S301 -- what the trace has written
    watched = Watched(exact, raising=False)
    with _seeded(seed), watching(watched):
        call(*args, **kwargs)
    if watched.first is None or watched.facts is None:
        raise LookupError("it found no model")
    return watched.first, watched.facts


@contextlib.contextmanager
def _seeded(number: int) -> Iterator[None]:
    """Give all generators that a library may draw from the same state, in every run."""
    random.seed(number)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.manual_seed(number)
    numpy = sys.modules.get("numpy")
    if numpy is None:
        yield
        return
    numpy.random.seed(number)
    own = numpy.random.default_rng

    def default_rng(seed: Any = None) -> Any:
        return own(number if seed is None else seed)

    numpy.random.default_rng = default_rng
    try:
        yield
    finally:
        numpy.random.default_rng = own


def main(results: str, files: list[str]) -> None:
    """Make calls again, one after the other."""
    missing.set_slack(0.0)
    with Path(results).open("a") as out:

        def tell(**line: object) -> None:
            out.write(json.dumps(line) + "\n")
            out.flush()

        for file in files:
            head, inputs = kept(Path(file))
            tell(begun=file)
            sys.path[:] = head["path"] + [path for path in sys.path if path not in head["path"]]
            try:
                system, function = head["key"][:2]
                own, exact = replay(system, function, inputs, crc32(Path(file).name.encode()))
            except Exception as error:  # noqa: BLE001 -- may be a stranger's code
                reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
                tell(done=file, why=f"the call failed when it was made again: {reason}")
            else:
                tell(done=file, n_inliers=[int(own[0]), int(exact[0])])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])

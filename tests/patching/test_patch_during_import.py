"""Patching while another thread is in the middle of importing the library waits for it."""

import importlib.abc
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from small_library import EXACT, LIBRARY, Library, MakeLibrary

import ransac_fix

# Set by the slow module when it begins, and waited for by it before it goes on.
GATES: dict[str, threading.Event] = {}

SLOW = """
import test_patch_during_import as test
test.GATES["begun"].set()
assert test.GATES["go on"].wait(30)
"""


@pytest.fixture(autouse=True)
def gates() -> Iterator[None]:
    GATES.update({"begun": threading.Event(), "go on": threading.Event()})
    yield
    GATES["go on"].set()


def _patch_during(library: Library) -> None:
    """Patch while the import stands still, then let it go on."""
    with ThreadPoolExecutor(2) as pool:
        importing = pool.submit(library.robust)
        assert GATES["begun"].wait(30)
        patching = pool.submit(ransac_fix.patch, library.name)
        with pytest.raises(TimeoutError):
            patching.result(0.2)
        GATES["go on"].set()
        importing.result(30)
        patching.result(30)


def test_while_the_module_runs(make_library: MakeLibrary) -> None:
    library = make_library(SLOW + LIBRARY)
    _patch_during(library)
    assert library.trials() == EXACT


def test_while_the_module_is_looked_for(library: Library) -> None:
    """The import has passed the place of our hook, and the module is not in sys.modules yet."""

    class SlowFinder(importlib.abc.MetaPathFinder):
        def find_spec(self, fullname, path=None, target=None):  # type: ignore[no-untyped-def]
            if fullname == library.module_name:
                GATES["begun"].set()
                assert GATES["go on"].wait(30)

    finder = SlowFinder()
    sys.meta_path.insert(0, finder)
    try:
        _patch_during(library)
    finally:
        sys.meta_path.remove(finder)
    assert library.trials() == EXACT


def test_a_block_waits_too(make_library: MakeLibrary) -> None:
    library = make_library(SLOW + LIBRARY)

    def block() -> float:
        with ransac_fix.patched(library.name):
            return library.trials()

    with ThreadPoolExecutor(2) as pool:
        importing = pool.submit(library.robust)
        assert GATES["begun"].wait(30)
        inside = pool.submit(block)
        GATES["go on"].set()
        importing.result(30)
        assert inside.result(30) == EXACT


def test_a_plan_that_imports_while_another_thread_patches(make_library: MakeLibrary) -> None:
    """The engine holds no lock of its own while it waits for an import: no deadlock."""
    library, other = make_library(SLOW + LIBRARY), make_library()
    ransac_fix.patch(library.name)
    with ThreadPoolExecutor(2) as pool:
        importing = pool.submit(library.robust)
        assert GATES["begun"].wait(30)
        # Goes through all the systems, of which one stands still.
        ransac_fix.patch(other.name)
        assert other.trials() == EXACT
        ransac_fix.unpatch(other.name)
        GATES["go on"].set()
        importing.result(30)
    assert library.trials() == EXACT

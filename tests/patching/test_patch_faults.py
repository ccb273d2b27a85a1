"""What can go wrong around a patch: no crash, no wrong result, and a status that says so."""

import importlib
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from small_library import APPROXIMATE, COUNTS, EXACT, LIBRARY, Library, MakeLibrary

import ransac_fix
from ransac_fix.errors import PatchNotApplicable, RansacFixWarning

EXACT_LIBRARY = LIBRARY.replace(
    "p = (n_inliers / n_samples) ** min_samples",
    "p = math.comb(n_inliers, min_samples) / math.comb(n_samples, min_samples)",
)
OTHER_SHAPE = LIBRARY.replace("_trials(", "_bound(")


def test_threads_patch_a_wrapped_library_while_others_call() -> None:
    """Every result is that of the library or that of the exact function, whole."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1000, (2, 24, 2))
    y[:7] = x[:7] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    y[7:15] = x[7:15] @ np.array([[1, 0.2], [-0.2, 1]]) - 9

    def find() -> bytes:
        model, mask = cv2.findHomography(x, y, cv2.RANSAC, 1.0, None, 100_000, 0.5)
        return bytes(model.tobytes() + mask.tobytes())

    bare = find()
    with ransac_fix.patched("opencv"):
        exact = find()
    own = cv2.findHomography
    stop = threading.Event()

    def call() -> set[bytes]:
        found = set()
        while not stop.is_set():
            found.add(find())
        return found

    def block() -> set[bytes]:
        found = set()
        while not stop.is_set():
            with ransac_fix.patched("opencv"):
                found.add(find())
        return found

    with ThreadPoolExecutor(4) as pool:
        callers, blocks = [pool.submit(call) for _ in range(2)], pool.submit(block)
        for turn in range(60):
            ransac_fix.patch("opencv")
            if turn % 7 == 0:
                assert find() == exact
            ransac_fix.unpatch("opencv")
        stop.set()
        assert blocks.result(60) == {exact}
        for caller in callers:
            assert caller.result(60) <= {bare, exact}
    assert cv2.findHomography is own
    assert find() == bare


@pytest.mark.parametrize("way", ["reload", "import anew"])
def test_an_upgrade_to_an_exact_release(make_library: MakeLibrary, way: str) -> None:
    library = make_library()
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    upgrade(library, EXACT_LIBRARY, way)
    assert library.trials() == EXACT
    assert library.status().state == "already exact"
    ransac_fix.unpatch(library.name)
    assert library.trials() == EXACT


@pytest.mark.parametrize("way", ["reload", "import anew"])
def test_an_upgrade_to_a_release_of_another_shape(make_library: MakeLibrary, way: str) -> None:
    library = make_library()
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    with pytest.warns(RansacFixWarning, match="has no function _trials"):
        upgrade(library, OTHER_SHAPE, way)
    assert library.trials() == APPROXIMATE
    status = library.status()
    assert status.state == "refused"
    assert "has no function _trials" in status.reason
    # ... and back again.
    upgrade(library, LIBRARY, way)
    assert library.trials() == EXACT
    assert library.status().state == "patched"


def upgrade(library: Library, source: str, way: str) -> None:
    path = library.folder / library.name / "robust.py"
    path.write_text(f"{source}\n# {len(path.read_text())}\n")
    importlib.invalidate_caches()
    name = library.module_name
    if way == "reload":
        module = sys.modules[name]
        vars(module).pop("_trials", None)  # a reload keeps what the new source does not have
        importlib.reload(module)
    else:
        del sys.modules[name]
        importlib.import_module(name)


def test_an_import_that_fails_half_way_and_is_tried_again(make_library: MakeLibrary) -> None:
    fails = "import os\nif 'ACME_BROKEN' in os.environ: raise OSError('half way')\n"
    library = make_library(fails + LIBRARY)
    ransac_fix.patch(library.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACME_BROKEN", "1")
        with pytest.raises(OSError, match="half way"):
            library.robust()
    assert library.status().state == "waiting"
    assert library.trials() == EXACT


@pytest.mark.parametrize("then", ["another import", "a look at the status", "patch"])
def test_a_module_that_is_imported_only_half(make_library: MakeLibrary, then: str) -> None:
    """The patch is asked for from within the import: what is there is half a module."""
    library, other = make_library(), make_library()
    path = library.folder / library.name / "robust.py"
    middle = (
        f"import ransac_fix\nransac_fix.patch({library.name!r})\n"
        f"states = {{s.system: s.state for s in ransac_fix.status().systems}}\n"
    )
    path.write_text(middle + LIBRARY)
    module = library.robust()
    assert module.states[library.name] == "waiting"
    if then == "another import":
        other.robust()
    elif then == "patch":
        ransac_fix.patch(library.name)
    else:
        assert library.status().state == "patched"
    assert module.estimate(*COUNTS) == EXACT
    assert library.status().state == "patched"


PLANS: dict[str, str] = {
    "says what is not a plan": "return 7",
    "exits": "raise SystemExit(3)",
    "replaces what is not there": (
        "return (Replacement(holder=module, name='nothing', exact=print),)"
    ),
}


@pytest.mark.parametrize("case", PLANS)
def test_a_third_partys_plan_that_goes_wrong(make_library: MakeLibrary, case: str) -> None:
    sound = make_library()
    broken = make_library(
        patch=(
            "from ransac_fix.patching.interface import LibraryPatch, Replacement\n"
            f"def plan(module):\n    {PLANS[case]}\n"
            "PATCH = LibraryPatch(system='{name}', requirements=('{name}-dist>=2',),"
            " modules=('{name}.robust',), plan=plan)\n"
        )
    )
    broken.robust()
    with pytest.raises(PatchNotApplicable):
        ransac_fix.patch(broken.name)
    with pytest.warns(RansacFixWarning, match="is left as it is"):
        ransac_fix.patch()
    assert broken.trials() == APPROXIMATE
    assert broken.status().state == "refused"
    assert sound.trials() == EXACT


def test_an_exact_function_that_raises_raises_as_the_library_would(
    make_library: MakeLibrary,
) -> None:
    library = make_library()
    ransac_fix.patch(library.name)
    for arguments in ((1, 2), ("a", "b", "c", "d")):
        with pytest.raises(TypeError):
            library.robust()._trials(*arguments)
    assert library.trials() == EXACT

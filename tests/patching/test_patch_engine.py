"""`patch`, `unpatch` and `status` on one library: order, names, shapes, reloads."""

import dataclasses
import importlib
import importlib.util
import inspect
import pickle
import sys
import warnings

import pytest
from small_library import APPROXIMATE, COUNTS, EXACT, LIBRARY, PATCH, Library, MakeLibrary

import ransac_fix
from ransac_fix import PatchNotApplicable, RansacFixError, RansacFixWarning
from ransac_fix.patching import finder, plugins


def test_patch_before_the_import(library: Library) -> None:
    ransac_fix.patch(library.name)
    assert library.module_name not in sys.modules
    assert library.status().state == "waiting"
    assert library.trials() == EXACT
    status = library.status()
    assert (status.state, status.process_wide, status.here) == ("patched", True, True)
    assert status.sites == (f"{library.module_name}._trials",)


def test_patch_after_the_import(library: Library) -> None:
    original = library.robust()._trials
    assert library.trials() == APPROXIMATE
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    ransac_fix.unpatch(library.name)
    assert library.trials() == APPROXIMATE
    assert library.robust()._trials is original
    assert library.status().state == "off"


def test_any_order_any_number_of_times(library: Library) -> None:
    for _ in range(2):
        ransac_fix.patch(library.name)
        ransac_fix.patch(library.name)
    stand_in = library.robust()._trials
    ransac_fix.patch(library.name)
    assert library.robust()._trials is stand_in
    ransac_fix.unpatch(library.name)
    assert library.trials() == APPROXIMATE
    ransac_fix.unpatch(library.name)
    ransac_fix.patch(library.name)
    assert library.robust()._trials is stand_in
    assert library.trials() == EXACT


def test_unpatch_before_the_import_leaves_nothing_behind(library: Library) -> None:
    ransac_fix.patch(library.name)
    ransac_fix.unpatch(library.name)
    assert library.module_name not in finder._watched
    assert library.trials() == APPROXIMATE
    assert not hasattr(library.robust()._trials, "__wrapped__")


@pytest.mark.parametrize("form", ["{}", "{}-dist", "{}_DIST"])
def test_system_distribution_and_import_names(library: Library, form: str) -> None:
    ransac_fix.patch(form.format(library.name))
    assert library.trials() == EXACT


def test_no_name_means_everything_installed(make_library: MakeLibrary) -> None:
    first, second = make_library(), make_library()
    ransac_fix.patch()
    assert first.trials() == second.trials() == EXACT


def test_an_unknown_name_lists_the_known_ones(library: Library) -> None:
    with pytest.raises(RansacFixError, match=rf"no patch for 'nonesuch'.*{library.name}"):
        ransac_fix.patch("nonesuch")


def test_a_system_without_a_patch(library: Library) -> None:
    with pytest.raises(RansacFixError, match="no patch for 'opengv'"):
        ransac_fix.patch("opengv")


def test_a_library_that_is_not_installed(make_library: MakeLibrary) -> None:
    library = make_library()
    (library.folder / library.name).rename(library.folder / "elsewhere")
    importlib.invalidate_caches()
    with pytest.raises(RansacFixError, match=f"{library.name} is not installed"):
        ransac_fix.patch(library.name)
    assert library.status().state == "not installed"
    ransac_fix.patch()  # means what is installed


def test_the_stand_in_looks_like_the_original(library: Library) -> None:
    original = library.robust()._trials
    ransac_fix.patch(library.name)
    stand_in = library.robust()._trials
    assert stand_in is not original
    assert inspect.signature(stand_in) == inspect.signature(original)
    for name in ("__doc__", "__name__", "__qualname__", "__module__"):
        assert getattr(stand_in, name) == getattr(original, name)
    assert type(stand_in(*COUNTS, 0.99)) is type(original(*COUNTS, 0.99))
    assert stand_in(n_inliers=6, n_samples=20, min_samples=2, probability=0.99) == EXACT
    assert pickle.loads(pickle.dumps(stand_in)) is stand_in
    with pytest.raises(TypeError):
        stand_in(6, 20)


def test_copies_made_by_from_import(library: Library) -> None:
    copier = library.folder / f"{library.name}_copier.py"
    copier.write_text(f"from {library.module_name} import _trials\n")
    module = importlib.import_module(copier.stem)
    original = library.robust()._trials
    assert module._trials is original
    ransac_fix.patch(library.name)
    assert module._trials(*COUNTS, 0.99) == EXACT
    ransac_fix.unpatch(library.name)
    assert module._trials is original
    with ransac_fix.patched(library.name):
        assert module._trials(*COUNTS, 0.99) == EXACT
    assert module._trials is original


def test_the_loader_is_not_in_sight(library: Library) -> None:
    ransac_fix.patch(library.name)
    found = importlib.util.find_spec(library.module_name)
    assert found is not None
    assert found.loader.get_source(library.module_name) == LIBRARY
    module = library.robust()
    assert type(module.__loader__) is importlib.machinery.SourceFileLoader
    assert type(module.__spec__.loader) is importlib.machinery.SourceFileLoader
    assert inspect.getsource(module) == LIBRARY


def test_the_finder_leaves_when_nothing_is_watched(library: Library) -> None:
    before = list(sys.meta_path)
    ransac_fix.patch(library.name)
    assert sys.meta_path != before
    ransac_fix.unpatch()
    assert sys.meta_path == before


def test_reload(library: Library) -> None:
    ransac_fix.patch(library.name)
    module = library.robust()
    importlib.reload(module)
    assert library.trials() == EXACT
    ransac_fix.unpatch()
    assert library.trials() == APPROXIMATE


def test_reload_while_off_is_seen_by_the_next_patch(library: Library) -> None:
    ransac_fix.patch(library.name)
    module = library.robust()
    ransac_fix.unpatch()
    importlib.reload(module)
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT


@pytest.mark.parametrize("patched_meanwhile", [True, False])
def test_a_library_imported_anew(library: Library, patched_meanwhile: bool) -> None:
    """An upgrade under a running program: the module is dropped and imported again."""
    ransac_fix.patch(library.name)
    old = library.robust()
    if not patched_meanwhile:
        ransac_fix.unpatch()
    for name in (library.module_name, library.name):
        del sys.modules[name]
    path = library.folder / library.name / "robust.py"
    path.write_text(LIBRARY + "\n# the next release\n")
    importlib.invalidate_caches()
    new = library.robust()
    ransac_fix.patch(library.name)
    assert new is not old
    assert new.estimate(*COUNTS) == EXACT
    assert library.trials() == EXACT


def test_a_wrapper_of_the_users_from_before(library: Library) -> None:
    module = library.robust()
    calls = []
    inner = module._trials

    def logged(n_inliers, n_samples, min_samples, probability):  # type: ignore[no-untyped-def]
        calls.append(n_inliers)
        return inner(n_inliers, n_samples, min_samples, probability)

    module._trials = logged
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    ransac_fix.unpatch()
    assert module._trials is logged
    assert library.trials() == APPROXIMATE
    assert calls


@pytest.mark.parametrize("well_behaved", [True, False])
def test_a_wrapper_of_the_users_from_after(library: Library, well_behaved: bool) -> None:
    import functools

    ransac_fix.patch(library.name)
    module = library.robust()
    inner = module._trials

    def logged(n_inliers, n_samples, min_samples, probability):  # type: ignore[no-untyped-def]
        return inner(n_inliers, n_samples, min_samples, probability)

    module._trials = functools.wraps(inner)(logged) if well_behaved else logged
    wrapper = module._trials
    assert library.trials() == EXACT
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    ransac_fix.unpatch()
    assert module._trials is wrapper
    assert library.trials() == APPROXIMATE
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT


def _changed(old: str, new: str) -> str:
    assert old in LIBRARY
    return LIBRARY.replace(old, new)


UNKNOWN = {
    "another formula": (
        _changed("math.log(1 - probability) /", "2 * math.log(1 - probability) /"),
        "neither the approximate nor the exact",
    ),
    "another signature": (
        LIBRARY.replace("min_samples", "size"),
        "takes n_inliers, n_samples, size, probability and not",
    ),
    "no rule": (LIBRARY.replace("_trials(", "_bound("), "has no function _trials"),
    "no loop": (LIBRARY.replace("estimate", "fit"), "has no function estimate"),
    "a loop that does not ask": (
        LIBRARY.replace("min(max_trials, _trials(", "max(max_trials, max("),
        "does not bound max_trials by calling _trials",
    ),
    "a rule that fails": (
        _changed("    if p == 1: return 1.0", "    raise RuntimeError('no')"),
        "neither the approximate nor the exact",
    ),
}


@pytest.mark.parametrize("case", UNKNOWN)
def test_an_unknown_shape_is_refused(make_library: MakeLibrary, case: str) -> None:
    source, reason = UNKNOWN[case]
    library = make_library(source)
    module = library.robust()
    before = dict(vars(module))
    with pytest.raises(PatchNotApplicable, match=reason):
        ransac_fix.patch(library.name)
    assert vars(module) == before
    with pytest.raises(PatchNotApplicable, match=reason), ransac_fix.patched(library.name):
        pass
    with pytest.warns(RansacFixWarning, match=reason):
        ransac_fix.patch()
    status = library.status()
    assert status.state == "refused"
    assert reason.split()[0] in status.reason
    assert vars(module) == before


@pytest.mark.parametrize("case", UNKNOWN)
def test_an_unknown_shape_met_in_an_import_is_a_warning(
    make_library: MakeLibrary, case: str
) -> None:
    source, reason = UNKNOWN[case]
    library = make_library(source)
    ransac_fix.patch(library.name)
    with pytest.warns(RansacFixWarning, match=reason):
        library.robust()
    assert library.status().state == "refused"


def test_warnings_turned_into_errors_do_not_stop_an_import(
    make_library: MakeLibrary, capsys: pytest.CaptureFixture[str]
) -> None:
    library = make_library(UNKNOWN["another formula"][0])
    ransac_fix.patch(library.name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        module = library.robust()
    assert module.estimate(6, 20, 2) == 98.0
    assert "neither the approximate" in capsys.readouterr().err


def test_all_or_none_of_several_names(make_library: MakeLibrary) -> None:
    good, bad = make_library(), make_library(UNKNOWN["another formula"][0])
    good.robust(), bad.robust()
    with pytest.raises(PatchNotApplicable, match=bad.name):
        ransac_fix.patch(good.name, bad.name)
    assert good.trials() == APPROXIMATE
    assert good.status().state == "off"


def test_already_exact_is_a_status(make_library: MakeLibrary) -> None:
    exact = LIBRARY.replace(
        "p = (n_inliers / n_samples) ** min_samples",
        "p = math.comb(n_inliers, min_samples) / math.comb(n_samples, min_samples)",
    )
    library = make_library(exact)
    original = library.robust()._trials
    ransac_fix.patch(library.name)
    assert library.status().state == "already exact"
    assert library.robust()._trials is original


@pytest.mark.parametrize(
    ("version", "checked"), [("2.1", True), ("3.0", False), ("2.5rc1", True), ("my own", False)]
)
def test_a_release_outside_the_declared_range_is_patched_when_it_fits(
    make_library: MakeLibrary, version: str, checked: bool
) -> None:
    library = make_library(version=version)
    ransac_fix.patch(library.name)
    assert library.trials() == EXACT
    status = library.status()
    assert (status.version, status.checked) == (version, checked)
    assert ("same shape" in status.reason) is not checked


def test_switched_off_by_the_environment(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RANSAC_FIX", "0")
    ransac_fix.patch(library.name)
    with ransac_fix.patched(library.name):
        assert library.trials() == APPROXIMATE
    assert library.status().state == "switched off"
    with pytest.raises(RansacFixError, match="no patch for"):
        ransac_fix.patch("nonesuch")


def test_switching_off_inside_a_block_is_safe(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ransac_fix.patched(library.name):
        monkeypatch.setenv("RANSAC_FIX", "0")
    monkeypatch.delenv("RANSAC_FIX")
    assert library.trials() == APPROXIMATE


BROKEN = {
    "does not import": ("raise OSError('disk on fire')", "OSError: disk on fire"),
    "has no patch": ("PATCH = 3", "no LibraryPatch named PATCH"),
    "does not parse": ("def (", "SyntaxError"),
    "has a bad requirement": (PATCH.replace(">=2,<3", " what"), "InvalidRequirement"),
    "has a bad module": (PATCH.replace("{name}.robust", "../robust"), "not the name of a module"),
    "has no module": (PATCH.replace('("{name}.robust",)', "()"), "lacks a system, a module or"),
    "leaves the program": ("raise SystemExit(3)", "SystemExit: 3"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_plugin_does_not_disturb_others(make_library: MakeLibrary, case: str) -> None:
    source, reason = BROKEN[case]
    good, broken = make_library(), make_library(patch=source)
    with pytest.warns(RansacFixWarning, match=reason):
        ransac_fix.patch()
    assert good.trials() == EXACT
    assert broken.status().state == "broken"
    assert reason in broken.status().reason
    with pytest.raises(PatchNotApplicable, match=reason):
        ransac_fix.patch(broken.name)


def test_a_plan_that_fails_is_a_refusal(make_library: MakeLibrary) -> None:
    patch = PATCH.replace("return count_rule(", "1 / 0\n    return count_rule(")
    library = make_library(patch=patch)
    ransac_fix.patch(library.name)
    with pytest.warns(RansacFixWarning, match="ZeroDivisionError"):
        library.robust()
    assert library.status().state == "refused"


def test_a_plan_for_what_is_not_there_is_a_refusal(make_library: MakeLibrary) -> None:
    patch = PATCH.replace(
        "return count_rule(",
        "from ransac_fix.patching.interface import Replacement\n"
        "    return (Replacement(holder=module, name='absent', exact=print),)\n"
        "    return count_rule(",
    )
    library = make_library(patch=patch)
    library.robust()
    with pytest.raises(PatchNotApplicable, match="has no absent"):
        ransac_fix.patch(library.name)


def test_two_patches_of_one_name(make_library: MakeLibrary) -> None:
    make_library(patch=PATCH.replace("{name}", "scikit-learn", 1))
    found = plugins.discover()
    assert found.patches["scikit-learn"].modules == ("sklearn.linear_model._ransac",)
    assert any("another patch for scikit-learn" in reason for reason in found.broken.values())


def test_status_is_frozen_and_says_who_inherits(library: Library) -> None:
    library.robust()
    with ransac_fix.patched(library.name):
        status = ransac_fix.status()
    entry = next(s for s in status.systems if s.system == library.name)
    assert (entry.process_wide, entry.here, entry.scopes) == (False, True, 1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        status.systems = ()  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        entry.state = "off"  # type: ignore[misc]
    text = str(status)
    assert f"{library.name} 2.1: patched, in this thread or task only" in text
    for word in ("Threads started inside the block", "joblib", "patched(threads=True)"):
        assert word in text

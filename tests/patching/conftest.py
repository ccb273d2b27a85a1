"""Small libraries, written to disk with the patches for them, for the engine to work on."""

import importlib
import itertools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from small_library import LIBRARY, PATCH, Library, MakeLibrary, install_patch

import ransac_fix
from ransac_fix.patching import engine, finder, plugins, registry

_NUMBER = itertools.count()


@pytest.fixture
def make_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeLibrary]:
    """Write libraries and patches for them, installed as far as entry points can tell."""
    made = []
    monkeypatch.syspath_prepend(tmp_path)

    def make(source: str = LIBRARY, patch: str | None = PATCH, version: str = "2.1") -> Library:
        name = f"acme{next(_NUMBER)}"
        package = tmp_path / name
        package.mkdir()
        (package / "__init__.py").write_text(f"__version__ = {version!r}\n")
        (package / "robust.py").write_text(source)
        if patch is not None:
            install_patch(tmp_path, name, patch.replace("{name}", name))
        made.append(name)
        importlib.invalidate_caches()
        plugins.discover.cache_clear()
        return Library(name, tmp_path)

    yield make
    plugins.discover.cache_clear()
    ransac_fix.unpatch()
    for name in made:
        engine._SYSTEMS.pop(name, None)
        for module in [m for m in sys.modules if m.partition(".")[0] in (name, f"{name}_patch")]:
            del sys.modules[module]
    for key, place in list(registry._PLACES.items()):
        if place.system in made:
            del registry._PLACES[key]
    monkeypatch.undo()
    plugins.discover.cache_clear()
    assert not any(name in finder._watched for name in made)


@pytest.fixture
def library(make_library: MakeLibrary) -> Library:
    return make_library()


@pytest.fixture
def run_python(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a program in an interpreter of its own; its folder is the working directory."""

    def run(
        *args: str | Path, environ: dict[str, str] | None = None, python: str = sys.executable
    ) -> subprocess.CompletedProcess[str]:
        clean = {k: v for k, v in os.environ.items() if not k.startswith("RANSAC_FIX")}
        return subprocess.run(
            [python, *map(str, args)],
            env=clean | (environ or {}),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
        )

    return run

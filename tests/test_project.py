"""The project's own files agree with each other."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_every_package_is_installed() -> None:
    inside = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / "ransac_fix").rglob("__init__.py")
    }
    mapped = {f"ransac_fix.{name}" for name in ("patches", "probes")}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == inside | mapped


def test_every_plugin_is_an_entry_point() -> None:
    for kind in ("patches", "probes"):
        modules = {
            f"ransac_fix.{kind}.{path.stem}"
            for path in (ROOT / kind).glob("*.py")
            if not path.stem.startswith("_")
        }
        assert set(PROJECT["project"]["entry-points"][f"ransac_fix.{kind}"].values()) == modules


def test_every_install_command_uses_the_constraints() -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    lines = [line for page in pages for line in page.read_text("utf-8").splitlines()]
    commands = [line for line in lines if re.search(r"pip install .*\[(audit|test)", line)]
    assert len(commands) >= 3
    for command in commands:
        assert "-c constraints.txt" in command


def test_readme_links_and_figures_exist() -> None:
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert (ROOT / target).exists(), f"{page.name} links to {target}"

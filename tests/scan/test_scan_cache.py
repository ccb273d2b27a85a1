"""The cache: what held nothing is not scanned again, and nothing else is remembered."""

from pathlib import Path

import joblib
import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.scan import scan_paths, scanner
from ransac_fix.scan.cache import default_cache, load, save

RULE = "from math import log\ndef ransac(w, s):\n    return log(1 - s) / log(1 - w**4)\n"
CLEAN = "from math import log\ndef ransac(w, s):\n    return log(1 - s) / log(1 - w)\n"


@pytest.fixture
def scanned(monkeypatch) -> list[str]:
    paths: list[str] = []
    real = scanner.scan_source

    def spy(source, file, *args, **options):
        paths.append(Path(file.path).name)
        return real(source, file, *args, **options)

    monkeypatch.setattr(scanner, "scan_source", spy)
    return paths


def test_only_what_holds_something_or_changed_is_scanned_again(tmp_path, scanned):
    source, cache = tmp_path / "src", tmp_path / "cache" / "scanned"
    source.mkdir()
    (source / "rule.py").write_text(RULE)
    (source / "clean.py").write_text(CLEAN)
    (source / "broken.py").write_text("def ransac(:\n  log(1 - w**k)\n")
    first = scan_paths([source], cache=cache)
    assert sorted(scanned) == ["broken.py", "clean.py", "rule.py"]
    scanned.clear()
    assert scan_paths([source], cache=cache) == first
    assert sorted(scanned) == ["broken.py", "rule.py"]
    scanned.clear()
    (source / "clean.py").write_text(CLEAN.replace("- w)", "- w**3)"))
    assert len(scan_paths([source], cache=cache).findings) == 2
    assert "clean.py" in scanned


def test_other_rules_are_another_matter(tmp_path, scanned):
    (tmp_path / "a.py").write_text(RULE)
    cache = tmp_path / "scanned"
    assert not scan_paths([tmp_path], cache=cache, select=["RFX102"]).findings
    assert scan_paths([tmp_path], cache=cache).findings


def test_a_damaged_cache_is_an_empty_one(tmp_path):
    cache = tmp_path / "scanned"
    assert load(cache) == frozenset()
    cache.write_bytes(b"x" * 37)
    assert load(cache) == {b"x" * 16}
    (tmp_path / "a.py").write_text(RULE)
    assert scan_paths([tmp_path], cache=cache).findings
    save(tmp_path / "a.py" / "no" / "folder", [b"y" * 16])


def test_the_command_has_one_and_can_do_without(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    (tmp_path / "a.py").write_text(CLEAN)
    CliRunner().invoke(cli, ["scan", "--no-cache", str(tmp_path / "a.py")])
    assert not default_cache().exists()
    CliRunner().invoke(cli, ["scan", str(tmp_path / "a.py")])
    assert default_cache().is_relative_to(tmp_path / "home")
    assert len(load(default_cache())) == 1


def test_a_warm_scan_starts_no_workers(tmp_path, monkeypatch):
    for number in range(300):
        (tmp_path / f"clean_{number}.py").write_text(f"{CLEAN}# {number}\n")
    cache = tmp_path / "scanned"
    first = scan_paths([tmp_path], cache=cache)

    def none_are_wanted(*args, **options):
        raise AssertionError("a worker was started")

    monkeypatch.setattr(joblib, "Parallel", none_are_wanted)
    done: list[tuple[int, int]] = []
    again = scan_paths(
        [tmp_path], jobs=2, cache=cache, progress=lambda *counts: done.append(counts)
    )
    assert again == first
    assert done[-1] == (300, 300)
    with pytest.raises(AssertionError, match="a worker"):
        scan_paths([tmp_path], jobs=2)


def test_a_named_file_is_not_known_from_a_folder(tmp_path):
    (tmp_path / "broken.py").write_text("def (:\n")
    cache = tmp_path / "scanned"
    assert not scan_paths([tmp_path], cache=cache).errors
    assert scan_paths([tmp_path / "broken.py"], cache=cache).errors

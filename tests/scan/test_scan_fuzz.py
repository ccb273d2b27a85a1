"""A small sample of what benchmarks/scan_fuzz.py does at length."""

import random
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.rules import all_rules
from ransac_fix.scan.scanner import scan_file

ROOT = Path(__file__).parents[2]
_spec = spec_from_file_location("scan_fuzz", ROOT / "benchmarks" / "scan_fuzz.py")
assert _spec is not None
assert _spec.loader is not None
fuzz = module_from_spec(_spec)
_spec.loader.exec_module(fuzz)

# Seconds each; test_cost_stays_bounded has one of each kind.
SLOW = ("loops nested", "calls in a ring", "expression grown")
EXAMPLES = [text.encode() for rule in all_rules() for text in rule.invalid.values()]


@pytest.mark.parametrize("suffix", [".py", ".cpp", ".ipynb"])
def test_changed_files_neither_crash_nor_go_by_in_silence(tmp_path, suffix):
    chance = random.Random(5)
    path = tmp_path / f"ransac{suffix}"
    for _ in range(40):
        kind, data = fuzz.changed(chance.choice(EXAMPLES), chance, chance.choice(EXAMPLES))
        if kind in SLOW:
            continue
        path.write_bytes(data)
        result = scan_file(SourceFile(str(path), LANGUAGES[suffix], named=True), gate=False)
        assert not fuzz.is_silent(path, result), kind

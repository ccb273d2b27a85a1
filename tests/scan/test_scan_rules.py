"""Every rule against the examples in its own file."""

import inspect
from collections.abc import Mapping

import pytest

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.rules import Rule, all_rules, find_rule
from ransac_fix.scan.scanner import scan_source

RULES = all_rules()
INVALID = [(rule, title) for rule in RULES for title in (*rule.invalid, *rule.cpp_invalid)]
VALID = [(rule, title) for rule in RULES for title in (*rule.valid, *rule.cpp_valid)]


def _id(value: object) -> str:
    return value.code if isinstance(value, Rule) else str(value).rstrip(".")


def codes(title: str, python: Mapping[str, str], cpp: Mapping[str, str]) -> list[str]:
    file = SourceFile("ransac.py", "python", named=True)
    if title in cpp:
        file = SourceFile("ransac.cpp", "c++", named=True)
    findings, errors = scan_source({**python, **cpp}[title], file, RULES)
    assert not errors
    return [finding.code for finding in findings]


@pytest.mark.parametrize(("rule", "title"), INVALID, ids=_id)
def test_finds_its_invalid_examples(rule, title):
    found = codes(title, rule.invalid, rule.cpp_invalid)
    assert found.count(rule.code) == 1
    # The same place may break another rule too, but not those that exclude each other.
    assert len({"RFX001", "RFX002", "RFX003"} & set(found)) <= 1


@pytest.mark.parametrize(("rule", "title"), VALID, ids=_id)
def test_leaves_its_valid_examples_alone(rule, title):
    assert rule.code not in codes(title, rule.valid, rule.cpp_valid)


@pytest.mark.parametrize("rule", RULES, ids=_id)
def test_has_all_that_a_rule_needs(rule):
    page = inspect.getdoc(type(rule)) or ""
    for section in ("What it does", "Why is this bad", "Use instead", "Fix safety"):
        assert f"\n{section}\n---" in page
    assert rule.name == rule.name.lower()
    assert " " not in rule.name
    assert len(rule.valid) >= 2
    assert len(rule.invalid) >= 2
    assert type(rule).__module__.endswith(rule.code.lower())


def test_codes_and_names_are_unique():
    assert len({rule.code for rule in RULES}) == len(RULES)
    assert len({rule.name for rule in RULES}) == len(RULES)


def test_is_found_by_code_and_by_name():
    assert find_rule("rfx001") is find_rule("approximate-stopping-rule")
    with pytest.raises(RansacFixError, match="there is no rule 'RFX7'"):
        find_rule("RFX7")

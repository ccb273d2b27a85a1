"""The pages of the rules are those that the rule files give."""

from pathlib import Path

import pytest

from ransac_fix.report.rule_text import rule_page
from ransac_fix.scan.rules import all_rules

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("rule", all_rules(), ids=lambda rule: rule.code)
def test_the_page_of_a_rule_is_up_to_date(rule):
    page = DOCS / "rules" / f"{rule.code}.md"
    assert page.read_text() == rule_page(rule), (
        f"write it again: python -m ransac_fix.report.rule_text {page.parent}"
    )


def test_the_table_names_every_rule():
    text = (DOCS / "scan.md").read_text()
    for rule in all_rules():
        assert f"| [{rule.code}](rules/{rule.code}.md) | {rule.name} | {rule.summary} |" in text

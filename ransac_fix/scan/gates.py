"""The first gate: which files could break a rule at all, by their bytes.

Of a site-packages one file in fifty passes, so this is where a scan spends its time on the others:
one search for all words that any of the rules needs, and only where one of them stands the
question of which. The gates lose nothing: the benchmarks run with and without them and compare.
"""

import os
from collections.abc import Sequence
from functools import cache

from ahocorasick_rs import BytesAhoCorasick, MatchKind

from ransac_fix.scan import words
from ransac_fix.scan.rules import Rule

_MARKS = (b"ransac-fix:", b"RFX")  # a comment that may set nothing aside


class Gate:
    """What keeps the files apart that could break some rules.

    Parameters
    ----------
    rules : sequence of Rule
    """

    def __init__(self, rules: Sequence[Rule]) -> None:
        self._rules = [rule for rule in rules if rule.reads_everything]
        needed = {*words.WORDS, *(mark.lower() for mark in _MARKS)}
        needs = [rule.needs() for rule in self._rules]
        for one in needs:
            needed.update(one)
        # A rule without words may be about any file: then there is nothing to search for. Of
        # matches that overlap one is enough, and with the leftmost one the search is vectorised.
        self._any = (
            BytesAhoCorasick(sorted(needed), matchkind=MatchKind.LeftmostFirst)
            if all(needs)
            else None
        )

    def keeps(self, path: str, data: bytes) -> bool:
        """Whether a file could break one of the rules, by its bytes and its path."""
        where, lowered = os.fsencode(path).lower(), data.lower()
        if self._any is not None and not (
            self._any.find_matches_as_indexes(lowered) or self._any.find_matches_as_indexes(where)
        ):
            return False
        lowered = where + b"\n" + lowered
        return (
            words.in_lowered(lowered)
            or any(rule.concerns(lowered) for rule in self._rules)
            or any(mark in data for mark in _MARKS)
        )


@cache
def gate_for(rules: tuple[Rule, ...]) -> Gate:
    """Give the gate of some rules."""
    return Gate(rules)

"""The rules, one file each: found by being here."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.rules.base import Rule, ScannedFile, SiteRule

__all__ = ["Rule", "ScannedFile", "SiteRule", "all_rules", "find_rule", "known_codes"]


@cache
def all_rules() -> tuple[Rule, ...]:
    """Load every rule of this folder, in order of code."""
    found: list[Rule] = []
    for module in iter_modules(__path__):
        if module.name.startswith("rfx"):
            members = vars(import_module(f"{__name__}.{module.name}")).values()
            found += [
                member()
                for member in members
                if isinstance(member, type) and issubclass(member, Rule) and "code" in vars(member)
            ]
    return tuple(sorted(found, key=lambda rule: rule.code))


@cache
def known_codes() -> frozenset[str]:
    """Give the codes of all rules."""
    return frozenset(rule.code for rule in all_rules())


def find_rule(code: str) -> Rule:
    """Find a rule by its code or name, in any case.

    Raises
    ------
    RansacFixError
        There is no such rule.
    """
    for rule in all_rules():
        if code.lower() in (rule.code.lower(), rule.name):
            return rule
    known = ", ".join(rule.code for rule in all_rules())
    raise RansacFixError(f"there is no rule {code!r}; the rules are {known}")

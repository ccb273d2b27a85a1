"""The rules, one file each: found by being here."""

from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.rules.base import DEFAULTS, Rule, ScannedFile, Settings, SiteRule

__all__ = [
    "DEFAULTS",
    "Rule",
    "ScannedFile",
    "Settings",
    "SiteRule",
    "all_rules",
    "choose",
    "default_codes",
    "default_rules",
    "find_rule",
]


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
def default_rules() -> tuple[Rule, ...]:
    """Give the rules that are checked where none is chosen."""
    return tuple(rule for rule in all_rules() if rule.default)


@cache
def default_codes() -> frozenset[str]:
    """Give the codes of these rules."""
    return frozenset(rule.code for rule in default_rules())


def choose(select: Iterable[str], ignore: Iterable[str]) -> tuple[str, ...]:
    """Give the codes of the rules to check, by code or by the start of one.

    Raises
    ------
    RansacFixError
        There is no such rule.
    """
    select, ignore = tuple(select), tuple(ignore)
    known = [rule.code for rule in all_rules()]
    for start in (*select, *ignore):
        if not start or not any(code.startswith(start) for code in known):
            raise RansacFixError(f"no rule {start!r}; the rules are {', '.join(known)}")
    return tuple(
        code
        for code in known
        if (code.startswith(select) if select else code in default_codes())
        and not code.startswith(ignore)
    )


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

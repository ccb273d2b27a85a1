"""Rules as text for the terminal, and as pages of the documentation."""

import inspect
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from ransac_fix.scan.rules import Rule, all_rules


def rules_text(rules: Iterable[Rule]) -> str:
    """Return one line a rule: code, name and summary."""
    known = list(rules)
    width = max(len(rule.name) for rule in known)
    return "".join(
        f"{rule.code}  {rule.name:{width}}  {rule.summary}"
        f"{'' if rule.default else ' (off by default)'}\n"
        for rule in known
    )


def rule_text(rule: Rule) -> str:
    """Return the page of one rule without its examples, for the terminal."""
    return f"# {rule.code} {rule.name}\n\n{rule_markdown(rule)}"


def rule_page(rule: Rule) -> str:
    """Return the page of one rule as Markdown, examples included."""
    parts = [rule_text(rule)]
    parts.append("\n## Found\n")
    parts += [*_examples(rule.invalid, "python"), *_examples(rule.cpp_invalid, "cpp")]
    parts.append("\n## Left alone\n")
    parts += [*_examples(rule.valid, "python"), *_examples(rule.cpp_valid, "cpp")]
    return "\n".join(parts)


def rule_markdown(rule: Rule) -> str:
    """Return what a rule says of itself as Markdown."""
    return _markdown(inspect.getdoc(type(rule)) or "")


def _examples(examples: Mapping[str, str], language: str) -> list[str]:
    return [f"{title}\n\n```{language}\n{code.strip()}\n```\n" for title, code in examples.items()]


def _markdown(text: str) -> str:
    """Turn the sections and literal blocks of a docstring into Markdown."""
    out: list[str] = []
    lines = text.split("\n")
    number = 0
    while number < len(lines):
        line = lines[number]
        under = lines[number + 1] if number + 1 < len(lines) else ""
        if line and len(under) == len(line) and set(under) == {"-"}:
            out.append(f"## {line}\n")
            number += 2
        elif line.startswith(".. code-block::"):
            language = line.partition("::")[2].strip()
            number += 2
            block: list[str] = []
            while number < len(lines) and (not lines[number] or lines[number][0] == " "):
                block.append(lines[number][4:])
                number += 1
            code = "\n".join(block).rstrip()
            out.append(f"```{language}\n{code}\n```\n")
        else:
            out.append(line.replace("``", "`"))
            number += 1
    return "\n".join(out).rstrip() + "\n"


def write_pages(folder: Path) -> None:
    """Write the page of every rule into a folder."""
    for rule in all_rules():
        (folder / f"{rule.code}.md").write_text(rule_page(rule), encoding="utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))

"""Make source that is almost Python 3 parse: IPython magics and Python 2 statements.

Only what keeps every other token on its line and column is changed (but for tabs mixed with
spaces, which move columns), so that places found in the repaired text are places of the original.
What cannot be repaired stays as it is, or is left out and the rest read without it.
"""

import ast
import re
import warnings
from typing import TYPE_CHECKING

from ransac_fix.scan.python import split_lines

if TYPE_CHECKING:
    from collections.abc import Callable

_MAGIC = re.compile(r"^(\s*)([%!?]|\?\?).*$")
_ASSIGNED_MAGIC = re.compile(r"^(\s*[\w., ]+=\s*)[%!].*$")
_HELP = re.compile(r"^(\s*)[\w.]+\?{1,2}\s*$")
_PRINT = re.compile(r"^(\s*(?:[^#'\"]*[:;]\s*)?)print(?=\s|$|['\"])(?!\s*[(=])(.*)$")
_PRINT_PARENTHESES = re.compile(r"^(\s*(?:[^#'\"]*[:;]\s*)?)print(\s*\(.*\)\s*(?:%|,).*)$")
_EXEC = re.compile(r"^(\s*)exec(?=\s)(.*)$")
_EXCEPT = re.compile(r"^(\s*except\s+[\w.()\s,]+?)\s*,\s*(\w+)\s*:")
_RAISE = re.compile(r"^(\s*)raise(\s+[\w.]+\s*,.*)$")
_NUMBER = re.compile(r"\b(\d+|0[xX][0-9a-fA-F]+)[lL]\b")
_OCTAL = re.compile(r"(?<![\w.])0([0-7]+)(?![\w.])")
_UNICODE_RAW = re.compile(r"\b[uU][rR](?=['\"])")
_NO_BLOCK = re.compile(r"expected an indented block after .* on line (\d+)")
_ATTEMPTS = 30
_MOST_PARSED = 4_000_000  # characters, in all attempts


def repair(source: str) -> str | None:
    """Repair a module that ``ast`` does not read.

    Parameters
    ----------
    source : str
        Text with a syntax error for Python 3.

    Returns
    -------
    str or None
        Text with the same lines that does parse, or None.
    """
    lines = [_magic(line) for line in split_lines(source)]
    if _error_line(lines) is None:
        return "\n".join(lines)
    lines = _expanded([_python2(line) for line in lines])
    for _ in range(_ATTEMPTS):
        number = _error_line(lines)
        if number is None:
            return "\n".join(lines)
        if not 0 < number <= len(lines):
            return None
        line = lines[number - 1]
        changed = _odd(line)
        if changed == line:
            return None
        lines[number - 1] = changed
    return None


def salvage(source: str) -> str | None:
    """Leave out the lines of a module that cannot be read, where they are few.

    Parameters
    ----------
    source : str
        Text that ``repair`` cannot mend.

    Returns
    -------
    str or None
        Text with the same lines that does parse, or None.
    """
    lines = _expanded([_python2(_magic(line)) for line in split_lines(source)])
    for _ in range(min(2 * _ATTEMPTS, _MOST_PARSED // (len(source) + 1))):
        error = _error(lines)
        if error is None:
            return "\n".join(lines)
        message, number = error
        block = _NO_BLOCK.search(message)
        number = int(block[1]) if block else number
        if not 0 < number <= len(lines):
            return None
        line = lines[number - 1]
        if "indent" in message and not block:
            lines[number - 1] = _lead_above(lines, number - 1) + line.strip()
        else:
            lines[number - 1] = _left_out(line, header=not block)
    return None


def _lead_above(lines: list[str], index: int) -> str:
    above = next((line for line in reversed(lines[:index]) if line.strip()), "")
    return above[: len(above) - len(above.lstrip())]


def _left_out(line: str, *, header: bool) -> str:
    """Put something in place of a line that leaves what is below it where it belongs."""
    changed = _odd(line)
    text = line.strip()
    if changed != line or text in ("pass", "if 1:"):
        return changed if changed != line else ""
    lead = line[: len(line) - len(line.lstrip())]
    return f"{lead}if 1:" if header and text.endswith(":") else f"{lead}pass"


def _error_line(lines: list[str]) -> int | None:
    error = _error(lines)
    return None if error is None else error[1]


def _error(lines: list[str]) -> tuple[str, int] | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ast.parse("\n".join(lines))
    except SyntaxError as error:
        return error.msg, error.lineno or 0
    except (ValueError, RecursionError, MemoryError):
        return "", 0
    return None


def _magic(line: str) -> str:
    """Put ``pass`` in place of what IPython reads itself."""
    for pattern in (_MAGIC, _HELP):
        found = pattern.match(line)
        if found:
            return f"{found[1]}pass"
    found = _ASSIGNED_MAGIC.match(line)
    return f"{found[1]}None" if found else line


def _python2(line: str) -> str:
    """Write the statements that Python 3 dropped as assignments, in as many characters."""
    for pattern, word in ((_PRINT, "_   ="), (_PRINT_PARENTHESES, "_   ="), (_EXEC, "_  =")):
        found = pattern.match(line)
        if found:
            rest = found[2].replace(">>", "  ", 1)
            if not rest.strip():
                return f"{found[1]}pass"
            return f"{found[1]}{word}{rest}"
    return line


def _odd(line: str) -> str:
    """Repair one line that is known to be wrong."""
    steps: tuple[Callable[[str], str], ...] = (
        lambda text: _EXCEPT.sub(r"\1 as \2:", text),
        lambda text: _RAISE.sub(r"\1_    =\2", text),
        lambda text: _NUMBER.sub(lambda found: f"{found[1]} ", text),
        lambda text: _OCTAL.sub(lambda found: f" {found[1]}", text),
        lambda text: _UNICODE_RAW.sub(" r", text),
        lambda text: text.replace("<>", "!="),
        lambda text: re.sub(r"`[^`]*`", lambda found: f"({found[0][1:-1]})", text),
    )
    for step in steps:
        changed = step(line)
        if changed != line:
            return changed
    return line


def _expanded(lines: list[str]) -> list[str]:
    """Write mixed leading tabs as Python 2 counted them, to the next multiple of eight."""
    leads = [line[: len(line) - len(line.lstrip(" \t"))] for line in lines]
    tabs, spaces = any("\t" in lead for lead in leads), any(" " in lead for lead in leads)
    if not (tabs and spaces):
        return lines
    return [lead.expandtabs(8) + line[len(lead) :] for lead, line in zip(leads, lines, strict=True)]

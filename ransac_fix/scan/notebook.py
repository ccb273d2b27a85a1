"""The notebook front end: the code cells of an .ipynb file as one Python module.

Cells are read in their order. Magics are set aside; a cell in another language (``%%bash``) and a
cell that cannot be read are left out, the latter with an error of its own.
"""

import json
import re
from dataclasses import dataclass
from json import decoder, scanner
from typing import TYPE_CHECKING, Any

from ransac_fix.scan import python
from ransac_fix.scan.repair import repair

if TYPE_CHECKING:
    from collections.abc import Callable

_OTHER_LANGUAGE = re.compile(
    r"^\s*%%(?:bash|sh|script|html|javascript|js|latex|markdown|svg|perl|ruby|cython|R|writefile"
    r"|sql|bigquery|cpp|cu|file)\b"
)


class NotANotebook(Exception):  # noqa: N818 -- the reason a file is skipped
    """The file is not a notebook in Python, and why."""


@dataclass(frozen=True, slots=True)
class CellLine:
    """Where a line of the module comes from."""

    cell: int
    line: int
    json_line: int


@dataclass(frozen=True, slots=True)
class Notebook:
    """A notebook as a module.

    Attributes
    ----------
    source : str
        The code of all cells, a Python 3 module.
    lines : tuple of CellLine
        For each line of ``source``, its cell, its line in the cell and its line in the file.
    unread : tuple of (int, str)
        Cells left out because they could not be read: their number and why.
    """

    source: str
    lines: tuple[CellLine, ...]
    unread: tuple[tuple[int, str], ...]


class _Place(str):
    """A string of a JSON document that knows where it stood."""

    __slots__ = ("offset",)
    offset: int


def read_notebook(text: str) -> Notebook:
    """Read a notebook.

    Raises
    ------
    NotANotebook
        The text is no JSON, no notebook, or its code is in another language.
    """
    try:
        document = _load(text)
    except (ValueError, RecursionError) as error:
        raise NotANotebook(f"not a notebook: {error}") from None
    if not isinstance(document, dict):
        raise NotANotebook("not a notebook: no object")
    language = _language(document)
    if language not in ("", "python", "python2", "python3", "ipython"):
        raise NotANotebook(f"its language is {language}")
    starts = _line_starts(text)
    source: list[str] = []
    lines: list[CellLine] = []
    unread: list[tuple[int, str]] = []
    number = 0
    for cell in _cells(document):
        if not isinstance(cell, dict) or cell.get("cell_type") != "code":
            continue
        number += 1
        pieces = cell.get("source", cell.get("input", ""))
        code, places = _join(pieces, starts)
        if not code.strip() or _OTHER_LANGUAGE.match(code):
            continue
        readable, why = _readable(code)
        if readable is None:
            unread.append((number, why))
            continue
        for index, line in enumerate(python.split_lines(readable)):
            source.append(line)
            place = places[min(index, len(places) - 1)] if places else 1
            lines.append(CellLine(number, index + 1, place))
    return Notebook("\n".join(source), tuple(lines), tuple(unread))


def _readable(code: str) -> tuple[str | None, str]:
    try:
        python.parse(code)
    except SyntaxError as error:
        repaired = repair(code)
        return repaired, f"line {error.lineno}: {error.msg}"
    except (ValueError, RecursionError) as error:
        return None, str(error)
    return code, ""


def _language(document: dict[str, Any]) -> str:
    metadata = document.get("metadata")
    if not isinstance(metadata, dict):
        return ""
    for key, name in (("kernelspec", "language"), ("language_info", "name")):
        part = metadata.get(key)
        if isinstance(part, dict) and isinstance(part.get(name), str):
            return str(part[name]).lower()
    return ""


def _cells(document: dict[str, Any]) -> list[Any]:
    cells = document.get("cells")
    if isinstance(cells, list):
        return cells
    # nbformat 3 keeps its cells in worksheets.
    worksheets = document.get("worksheets")
    found: list[Any] = []
    for sheet in worksheets if isinstance(worksheets, list) else []:
        if isinstance(sheet, dict) and isinstance(sheet.get("cells"), list):
            found += sheet["cells"]
    return found


def _join(pieces: object, starts: list[int]) -> tuple[str, list[int]]:
    """Join the strings of a cell; give the line in the file of each line of the cell."""
    if isinstance(pieces, str):
        pieces = [pieces]
    if not isinstance(pieces, list):
        return "", []
    code = ""
    places: list[int] = []
    for piece in pieces:
        if not isinstance(piece, str):
            continue
        line = _line_of(getattr(piece, "offset", 0), starts)
        if not code or code.endswith("\n"):
            places.append(line)
        places += [line] * (len(python.split_lines(str(piece))) - 1)
        if piece.endswith("\n"):
            places.pop()
        code += str(piece)
    return code, places


def _line_starts(text: str) -> list[int]:
    return [0, *(found.end() for found in re.finditer(r"\n", text))]


def _line_of(offset: int, starts: list[int]) -> int:
    low, high = 0, len(starts)
    while high - low > 1:
        middle = (low + high) // 2
        if starts[middle] <= offset:
            low = middle
        else:
            high = middle
    return low + 1


def _load(text: str) -> Any:
    """Read JSON in which each string value knows its offset."""
    reader = json.JSONDecoder()
    plain: Callable[..., tuple[str, int]] = decoder.scanstring  # type: ignore[attr-defined]

    def located(string: str, end: int, strict: bool = True) -> tuple[str, int]:
        value, after = plain(string, end, strict)
        place = _Place(value)
        place.offset = end
        return place, after

    reader.parse_string = located  # type: ignore[attr-defined]
    reader.scan_once = scanner.py_make_scanner(reader)  # type: ignore[attr-defined]
    return reader.decode(text)

"""The notebook front end: the code cells of an .ipynb file as one Python module.

Cells are read in their order. Magics are set aside; a cell in another language (``%%bash``) and
lines that cannot be read are left out, the latter with an error for their cell.
"""

import json
import re
from dataclasses import dataclass
from json import decoder, scanner
from typing import TYPE_CHECKING, Any

from ransac_fix.scan import python
from ransac_fix.scan.findings import Edit, Location
from ransac_fix.scan.repair import repair, salvage

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_OTHER_LANGUAGE = re.compile(
    r"^\s*%%(?:bash|sh|script|html|javascript|js|latex|markdown|svg|perl|ruby|cython|R|sql|bigquery"
    r"|cpp|cu|(?:write)?file\b(?!.*\.py\s*$))\b",
    re.MULTILINE,
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
        Cells that could not be read, or not all of them: their number and why.
    text : str
        The JSON text itself.
    cells : mapping of int to CodeCell
        The cells that were read, by number.
    """

    source: str
    lines: tuple[CellLine, ...]
    unread: tuple[tuple[int, str], ...]
    text: str
    cells: "Mapping[int, CodeCell]"

    def edit(self, edit: Edit) -> Edit | None:
        """Turn a change of the module into one of the JSON text; None where columns moved."""
        place = edit.location
        start = self.lines[place.start_line - 1]
        end = self.lines[place.end_line - 1]
        cell = self.cells[start.cell]
        if start.cell != end.cell or cell.moved:
            return None
        first, separator = cell.offset(self.text, start.line, place.start_column - 1)
        last, _ = cell.offset(self.text, end.line, place.end_column - 1)
        content = json.dumps(edit.content, ensure_ascii=self.text.isascii())[1:-1]
        if separator:  # one string a line
            content = content.replace("\\n", f'\\n"{separator}"')
        location = Location(place.path, *_place_of(self.text, first), *_place_of(self.text, last))
        return Edit(location, content)


@dataclass(frozen=True, slots=True)
class CodeCell:
    """A cell as it stands in the JSON text.

    Attributes
    ----------
    pieces : tuple of (str, int)
        Its strings, and where the text of each begins, behind the quotation mark.
    listed : bool
        Whether they are a list.
    moved : bool
        Whether it was repaired in a way that moves columns, or read without some lines.
    """

    pieces: tuple[tuple[str, int], ...]
    listed: bool
    moved: bool

    def offset(self, text: str, line: int, column: int) -> tuple[int, str]:
        """Give the place of a line and column in the JSON text, and what separates lines there."""
        code = "".join(piece for piece, _ in self.pieces)
        starts = [0, *(found.end() for found in re.finditer(r"\r\n|\r|\n", code))]
        rest = starts[line - 1] + column
        for number, (piece, offset) in enumerate(self.pieces):
            if rest < len(piece) or number == len(self.pieces) - 1:
                separator = _separator(text, offset) if self.listed else ""
                return _raw(text, offset, rest), separator
            rest -= len(piece)
        raise AssertionError("a cell with an edit has text")


def _raw(text: str, offset: int, characters: int) -> int:
    """Step over characters of a JSON string, as they are escaped."""
    for _ in range(characters):
        if text[offset] != "\\":
            offset += 1
        elif text[offset + 1] != "u":
            offset += 2
        else:
            pair = text[offset + 2].lower() == "d" and text[offset + 3].lower() in "89ab"
            offset += 12 if pair and text[offset + 6 : offset + 8] == "\\u" else 6
    return offset


def _separator(text: str, offset: int) -> str:
    """Give what stands between two strings of the list that a string belongs to."""
    lead = text[: offset - 1]
    blank = lead[len(lead.rstrip()) :]
    return f",{blank}"


def _place_of(text: str, offset: int) -> tuple[int, int]:
    before = text[:offset]
    lines = [0, *(found.end() for found in re.finditer(r"\r\n|\r|\n", before))]
    return len(lines), offset - lines[-1] + 1


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
    cells: dict[int, CodeCell] = {}
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
        if why:
            unread.append((number, why))
        if readable is None:
            continue
        moved = bool(why) or any(
            new != old and new.expandtabs() == old.expandtabs()
            for new, old in zip(
                python.split_lines(readable), python.split_lines(code), strict=False
            )
        )
        cells[number] = _code_cell(pieces, moved=moved)
        for index, line in enumerate(python.split_lines(readable)):
            source.append(line)
            place = places[min(index, len(places) - 1)] if places else 1
            lines.append(CellLine(number, index + 1, place))
    return Notebook("\n".join(source), tuple(lines), tuple(unread), text, cells)


def _code_cell(pieces: object, *, moved: bool) -> CodeCell:
    listed = isinstance(pieces, list)
    strings = pieces if isinstance(pieces, list) else [pieces]
    placed = tuple((str(one), one.offset) for one in strings if isinstance(one, _Place))
    return CodeCell(placed, listed, moved)


def _readable(code: str) -> tuple[str | None, str]:
    """Give the text of a cell that can be read, and why not all of it can."""
    try:
        python.parse(code)
    except SyntaxError as error:
        repaired = repair(code)
        if repaired is not None:
            return repaired, ""
        return salvage(code), f"line {error.lineno}: {error.msg}"
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

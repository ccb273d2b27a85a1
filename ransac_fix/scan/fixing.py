"""Write fixes into files, or show what would be written."""

import difflib
import os
import stat
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.findings import Edit, Finding, ScanError
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.scanner import encoding_of, scan_source


@dataclass(frozen=True, slots=True)
class FixedFile:
    """A file and what its fixes make of it."""

    path: str
    before: str
    after: str
    fixed: tuple[Finding, ...]
    encoding: str

    def diff(self) -> str:
        """Return the change as a unified diff."""
        lines = difflib.unified_diff(
            self.before.splitlines(keepends=True),
            self.after.splitlines(keepends=True),
            self.path,
            self.path,
        )
        return "".join(
            line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
            for line in lines
        )

    def encoded(self) -> bytes:
        """Return the fixed file in the encoding of the original."""
        return self.after.encode(self.encoding)

    def write(self) -> None:
        """Replace the file, all at once, keeping its mode.

        Raises
        ------
        OSError
            The folder cannot be written to.
        """
        target = os.path.realpath(self.path)
        folder, name = os.path.split(target)
        descriptor, temporary = tempfile.mkstemp(prefix=f".{name}.", dir=folder)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(self.encoded())
            Path(temporary).chmod(stat.S_IMODE(Path(target).stat().st_mode))
            Path(temporary).replace(target)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


def fix_findings(
    findings: Sequence[Finding],
    *,
    unsafe: bool,
    contents: Mapping[str, bytes] | None = None,
) -> tuple[list[FixedFile], list[ScanError]]:
    """Work out what the fixes of findings make of their files.

    Parameters
    ----------
    findings : sequence of Finding
    unsafe : bool
        Whether fixes that are not safe are made too.
    contents : mapping of str to bytes, optional
        What stands in files that are not to be read, such as standard input.

    Returns
    -------
    fixed : list of FixedFile
    errors : list of ScanError
        Files left alone because the result would not have been right.
    """
    by_path: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.fix is not None and (finding.fix.safe or unsafe):
            by_path.setdefault(finding.location.path, []).append(finding)
    fixed: list[FixedFile] = []
    errors: list[ScanError] = []
    for path, wanted in by_path.items():
        data = (contents or {}).get(path)
        language = LANGUAGES.get(Path(path).suffix.lower(), "python")
        try:
            data = Path(path).read_bytes() if data is None else data
            encoding = encoding_of(data, language)
            before = data.decode(encoding)
        except (OSError, UnicodeError, SyntaxError, LookupError) as error:
            errors.append(ScanError(path, f"left alone: it changed meanwhile: {error}", named=True))
            continue
        made, edits = _together(wanted)
        after = apply_edits(before, edits)
        file = SourceFile(path, language, named=True)
        if _is_right(before, after, file, made):
            fixed.append(FixedFile(path, before, after, tuple(made), encoding))
        else:
            errors.append(ScanError(path, "left alone: the fixed file would not be right"))
    return fixed, errors


def _together(wanted: Sequence[Finding]) -> tuple[list[Finding], list[Edit]]:
    """Choose the fixes that can be made at once: each whole or not at all, none over another."""
    made: list[Finding] = []
    edits: dict[Edit, None] = {}
    for finding in wanted:
        new = [] if finding.fix is None else [one for one in finding.fix.edits if one not in edits]
        if not any(_overlap(one, other) for one in new for other in edits):
            made.append(finding)
            edits.update(dict.fromkeys(new))
    return made, list(edits)


def _overlap(one: Edit, other: Edit) -> bool:
    a, b = one.location, other.location
    starts = max((a.start_line, a.start_column), (b.start_line, b.start_column))
    ends = min((a.end_line, a.end_column), (b.end_line, b.end_column))
    return starts < ends


def _is_right(before: str, after: str, file: SourceFile, made: Sequence[Finding]) -> bool:
    """Whether the result can be read, and holds nothing but what was not fixed of the original."""
    old, _ = scan_source(before, file)
    new, errors = scan_source(after, file)
    expected = Counter(one.code for one in old if one.suppression is None)
    expected.subtract(one.code for one in made)
    left = Counter(one.code for one in new if one.suppression is None)
    # A wrong exponent, or a guard that was missing, may go with the power it was found in; and that
    # all data may be inliers may show only where the counts stand side by side (RFX005).
    return not errors and all(
        count <= expected[code] for code, count in left.items() if code != "RFX005"
    )

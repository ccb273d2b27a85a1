"""Write fixes into files, or show what would be written."""

import difflib
import os
import stat
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.findings import Finding, ScanError
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
                stream.write(self.after.encode(self.encoding))
            Path(temporary).chmod(stat.S_IMODE(Path(target).stat().st_mode))
            Path(temporary).replace(target)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


def fix_findings(
    findings: Sequence[Finding], *, unsafe: bool
) -> tuple[list[FixedFile], list[ScanError]]:
    """Work out what the fixes of findings make of their files.

    Parameters
    ----------
    findings : sequence of Finding
    unsafe : bool
        Whether fixes that are not safe are made too.

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
        data = Path(path).read_bytes()
        encoding = encoding_of(data)
        before = data.decode(encoding)
        after = apply_edits(before, [edit for one in wanted if one.fix for edit in one.fix.edits])
        if _is_right(
            path, after, [one.code for one in findings if one.location.path == path], wanted
        ):
            fixed.append(FixedFile(path, before, after, tuple(wanted), encoding))
        else:
            errors.append(ScanError(path, "left alone: the fixed file would not be right"))
    return fixed, errors


def _is_right(path: str, after: str, codes: Sequence[str], wanted: Sequence[Finding]) -> bool:
    """Whether the result can be read, and holds what the original held but for what was fixed."""
    language = LANGUAGES.get(Path(path).suffix.lower(), "python")
    findings, errors = scan_source(after, SourceFile(path, language, named=True))
    left = sorted(one.code for one in findings if one.suppression is None)
    expected = list(codes)
    for one in wanted:
        expected.remove(one.code)
    return not errors and [code for code in left if code in codes] == sorted(expected)

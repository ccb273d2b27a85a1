"""What a scan gives: findings, errors, and the two together."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Certainty: TypeAlias = Literal["high", "medium", "low"]
Severity: TypeAlias = Literal["warning", "note"]
"""Whether a finding makes the scan fail; a note does not."""
FixStyle: TypeAlias = Literal["self-contained", "import"]
"""Whether a fix adds a function to the file, or imports this package's."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A place in a notebook: the code cell, counted from 1, and the line in it."""

    index: int
    line: int


@dataclass(frozen=True, slots=True)
class Location:
    """A range of a file: lines and columns from 1, the end column exclusive.

    In a notebook lines are those of its JSON text, and ``cell`` says where a reader finds it.
    """

    path: str
    start_line: int
    start_column: int
    end_line: int
    end_column: int
    cell: Cell | None = None


@dataclass(frozen=True, slots=True)
class Related:
    """Another place that belongs to a finding, and what it has to do with it."""

    location: Location
    message: str


@dataclass(frozen=True, slots=True)
class Edit:
    """A change of the text of a file: what stands in ``location`` becomes ``content``."""

    location: Location
    content: str


@dataclass(frozen=True, slots=True)
class Fix:
    """A change that makes a finding go away.

    Attributes
    ----------
    message : str
        What it does.
    safe : bool
        Whether it changes the number of trials and nothing else. Fixes that change what is drawn,
        or that rest on names alone for what is a count, are not.
    edits : tuple of Edit
    """

    message: str
    safe: bool
    edits: tuple[Edit, ...]


@dataclass(frozen=True, slots=True)
class Finding:
    """One place where a rule of ``scan/rules`` is broken.

    Attributes
    ----------
    code : str
        The rule, such as ``RFX001``.
    location : Location
        The whole expression or statement it is about.
    certainty : {"high", "medium", "low"}
        How sure: from the structure first, from names and context second.
    message : str
        What is wrong there, in one line.
    roles : mapping
        Source text of what was recognised: ``inlier_ratio``, ``n_inliers``, ``n_samples``,
        ``sample_size``, ``confidence``, as far as each could be named.
    expression : str
        The source of the place with its white space normalised.
    related : tuple of Related
        Other places, such as where the sample is drawn.
    fix : Fix or None
    no_fix : str
        Why there is none.
    suppression : str or None
        The reason given by the comment that sets it aside; None where there is no such comment.
    severity : {"warning", "note"}
        A note says something of the text beside the code, and does not make the scan fail.
    callee : str
        The function that takes a ratio which other files may make of its counts, where there is no
        fix for that.
    """

    code: str
    location: Location
    certainty: Certainty
    message: str
    roles: Mapping[str, str] = field(default_factory=dict)
    expression: str = ""
    related: tuple[Related, ...] = ()
    fix: Fix | None = None
    no_fix: str = ""
    suppression: str | None = None
    severity: Severity = "warning"
    callee: str = ""


@dataclass(frozen=True, slots=True)
class ScanError:
    """A file or folder that could not be scanned (RFX900), and why.

    ``named`` says that the user named this file: only then is it an error of the whole scan.
    """

    path: str
    message: str
    line: int | None = None
    named: bool = False
    code: str = "RFX900"


@dataclass(frozen=True, slots=True)
class ScanResult:
    """All that one scan found, in order of path and place."""

    findings: tuple[Finding, ...]
    errors: tuple[ScanError, ...]
    files: int
    """How many files were looked at."""
    suppressed: tuple[Finding, ...] = ()
    """What comments set aside."""

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """The findings that make the scan fail: all but notes."""
        return tuple(finding for finding in self.findings if finding.severity == "warning")

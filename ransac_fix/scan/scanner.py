"""From one file to its findings: gate, parse, recognise, rules, positions.

Nothing that is scanned is ever imported or run.
"""

import ast
import codecs
import re
import tokenize
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache

from ransac_fix.scan import evaluate, python, triage
from ransac_fix.scan.cache import digest_of
from ransac_fix.scan.facts import may_hold_a_rule
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.findings import Cell, Finding, Location, Related, ScanError
from ransac_fix.scan.form import Module
from ransac_fix.scan.gates import gate_for
from ransac_fix.scan.nodes import TooComplex
from ransac_fix.scan.notebook import NotANotebook, Notebook, read_notebook
from ransac_fix.scan.prose import Prose, blocks, may_state_a_rule, python_prose
from ransac_fix.scan.reading import ReadSite, Text, read_sites
from ransac_fix.scan.recogniser import recognise
from ransac_fix.scan.repair import repair, salvage
from ransac_fix.scan.rules import (
    DEFAULTS,
    Rule,
    ScannedFile,
    Settings,
    all_rules,
    default_codes,
    default_rules,
)
from ransac_fix.scan.suppressions import (
    Comment,
    apply,
    has_any,
    python_comments,
    suppressions,
)

_MAX_BYTES = 20_000_000
_LINE_END = re.compile(r'\\n(?:",?\s*")?')

FileOutcome = tuple[tuple[Finding, ...], tuple[ScanError, ...]]


@dataclass(frozen=True, slots=True)
class FileResult:
    """What one file gave; ``digest`` when that took looking, is nothing and is to be remembered."""

    findings: tuple[Finding, ...] = ()
    errors: tuple[ScanError, ...] = ()
    digest: bytes | None = None


def read_file(file: SourceFile) -> bytes | ScanError:
    """Read a file, no more of it than is scanned."""
    try:
        with open(file.path, "rb") as stream:  # noqa: PTH123 -- ten thousand times a scan
            return stream.read(_MAX_BYTES + 1)
    except OSError as error:
        return _error(file, f"cannot be read: {error.strerror or error}")


def is_known(
    file: SourceFile, rules: Sequence[Rule], known: frozenset[bytes], *, gate: bool = True
) -> bool:
    """Whether a file breaks none of the rules: by its bytes alone, or as is known of them."""
    data = read_file(file)
    if isinstance(data, ScanError):
        return False
    if gate and is_gated(data, file, rules):
        return True
    return digest_of(file, data, _codes(rules)) in known


def is_gated(data: bytes, file: SourceFile, rules: Sequence[Rule]) -> bool:
    """Whether a file is set aside by its bytes alone; one that is too large never is."""
    if file.named or len(data) > _MAX_BYTES:
        return False
    return not gate_for(tuple(rules)).keeps(file.path, data)


def _codes(rules: Sequence[Rule]) -> tuple[str, ...]:
    return tuple(rule.code for rule in rules)


def scan_file(
    file: SourceFile,
    rules: Sequence[Rule] | None = None,
    *,
    gate: bool = True,
    remember: bool = False,
    settings: Settings = DEFAULTS,
) -> FileResult:
    """Scan one file.

    Parameters
    ----------
    file : SourceFile
    rules : sequence of Rule, optional
        The rules to check; those that are checked by default.
    gate : bool
        Whether files and definitions are set aside by their text alone.
    remember : bool
        Whether to give the digest of a file that holds nothing.
    settings : Settings
        What the user chose of fixes and of the environment.
    """
    data = read_file(file)
    if isinstance(data, ScanError):
        return FileResult(errors=(data,))
    return scan_data(data, file, rules, gate=gate, remember=remember, settings=settings)


def scan_data(
    data: bytes,
    file: SourceFile,
    rules: Sequence[Rule] | None = None,
    *,
    gate: bool = True,
    remember: bool = False,
    settings: Settings = DEFAULTS,
) -> FileResult:
    """Scan what a file holds; the parameters are those of :func:`scan_file`."""
    chosen = default_rules() if rules is None else rules
    if len(data) > _MAX_BYTES:
        message = f"skipped: larger than {_MAX_BYTES // 1_000_000} MB"
        return FileResult(errors=(_error(file, message),))
    if gate and is_gated(data, file, chosen):
        return FileResult()  # to search it once more takes less than to digest it
    digest = digest_of(file, data, _codes(chosen)) if remember else None
    try:
        source = decode(data, file.language)
    except (SyntaxError, UnicodeError, LookupError) as error:
        return FileResult(errors=(_error(file, f"cannot be decoded: {error}"),))
    findings, errors = scan_source(source, file, chosen, gate=gate, settings=settings)
    return FileResult(findings, errors, None if findings or errors else digest)


def scan_source(
    source: str,
    file: SourceFile,
    rules: Sequence[Rule] | None = None,
    *,
    gate: bool = True,
    settings: Settings = DEFAULTS,
) -> FileOutcome:
    """Scan text that is already in hand; ``file`` says what it is."""
    chosen = default_rules() if rules is None else rules
    try:
        if file.language == "notebook":
            return _scan_notebook(source, file, chosen, gate=gate, settings=settings)
        if file.language == "c++":
            return _scan_cpp(source, file, chosen, gate=gate)
        return _scan_python(source, file, chosen, gate=gate, settings=settings)
    except RecursionError:
        return (), (_error(file, "nested too deeply"),)
    except MemoryError:
        return (), (_error(file, "too complex: out of memory"),)
    except TooComplex:
        return (), (_error(file, "too complex: more expressions than code written by hand has"),)


def decode(data: bytes, language: str = "python") -> str:
    """Decode source as its language does.

    Python by its byte order mark, its coding line, or as UTF-8; C++ as UTF-8 or, where it is not,
    as Latin-1, which reads any bytes; notebooks as UTF-8.

    Raises
    ------
    SyntaxError, UnicodeError, LookupError
        The bytes are not text in the encoding that the file declares.
    """
    return data.decode(encoding_of(data, language))


def encoding_of(data: bytes, language: str = "python") -> str:
    """Give the encoding of source, ``utf-8-sig`` where it opens with a byte order mark.

    Raises
    ------
    SyntaxError
        The source declares an encoding that does not exist.
    """
    if language != "python":
        encoding = "utf-8-sig" if data.startswith(codecs.BOM_UTF8) else "utf-8"
        if language == "c++":
            try:
                data.decode(encoding)
            except UnicodeDecodeError:
                return "latin-1"
        return encoding
    lines = iter(data.split(b"\n", 2)[:2])
    encoding, _ = tokenize.detect_encoding(lambda: next(lines, b""))
    return encoding


def _scan_python(
    source: str, file: SourceFile, rules: Sequence[Rule], *, gate: bool, settings: Settings
) -> FileOutcome:
    # A named file is parsed in any case: that it cannot be is what its user must learn.
    commented = has_any(source)
    code, written = triage.split(source)
    stated = _may_be_stated(source, written, rules)
    noted = commented or stated
    quiet = _quiet(source, rules) if gate else frozenset()
    stub = file.path.endswith(".pyi") and not noted  # it computes nothing
    if gate and stub and not file.named:
        return (), ()
    wanted = noted or any(rule.reads_everything and rule.code not in quiet for rule in rules)
    could = not gate or triage.could_hold_a_rule(code)
    if not (could or wanted or file.named):
        return (), ()
    repaired = False
    errors: tuple[ScanError, ...] = ()
    try:
        tree = python.tree(source)
    except SyntaxError as error:
        text = repair(source)
        if text is None:
            message = f"not Python that can be read: {error.msg}"
            text = salvage(source) if could else None
            if text is not None:
                message += "; the lines around it were scanned"
            errors = (_error(file, message, error.lineno),)
        if text is None:
            return (), errors
        source, repaired = text, True
        tree = python.tree(source)
    except ValueError as error:
        return (), (_error(file, f"not Python that can be read: {error}"),)
    if gate and (could or repaired):
        could = may_hold_a_rule(tree)
    if not (could or wanted):
        return (), errors

    @cache
    def whole() -> Module:
        return python.read(tree, source)

    # Where no rule can stand, names are enough; some rules then ask for the whole.
    module = whole() if could else python.read(tree, source, set())
    comments = tuple(python_comments(source)) if commented else ()
    findings = check(
        module,
        Text(source),
        file.path,
        rules,
        whole=whole,
        quiet=quiet,
        comments=comments,
        language="python 2" if repaired else "python",
        settings=settings,
        prose=tuple(python_prose(source, tree)) if stated else (),
    )
    if findings and not repaired:
        of_code = {one.code for one in rules if one.about_code}
        return _confirmed(source, tree, file, findings, of_code)
    if errors:
        why = "the file cannot be read whole"
        findings = [replace(one, fix=None, no_fix=why) for one in findings]
    return tuple(findings), errors


def _may_be_stated(source: str, written: str, rules: Sequence[Rule]) -> bool:
    """Whether a rule reads comments and docstrings, and one of them could say something."""
    return any(rule.reads_prose for rule in rules) and may_state_a_rule(source, written)


def check(
    module: Module,
    text: Text,
    path: str,
    rules: Sequence[Rule] | None = None,
    *,
    whole: Callable[[], Module] | None = None,
    quiet: Collection[str] = (),
    comments: tuple[Comment, ...] = (),
    language: str = "python",
    settings: Settings = DEFAULTS,
    prose: tuple[Prose, ...] = (),
) -> list[Finding]:
    """Check one module in the small form.

    Parameters
    ----------
    module : Module
        The file, or the part of it that could hold a rule.
    text : Text
    path : str
    rules : sequence of Rule, optional
        The rules to check; those that are checked by default.
    whole : callable, optional
        Gives the whole file, where ``module`` is a part of it.
    quiet : collection of str
        The rules that can find nothing here, by their code.
    comments : tuple of Comment
        Its comments, where one could set a finding aside.
    language, settings, prose
        As in :class:`~ransac_fix.scan.rules.ScannedFile`.

    Returns
    -------
    list of Finding
        In order of place; those set aside have a ``suppression``.
    """
    sites = read(module, text, path, whole)
    scanned = ScannedFile(
        path, text, module, tuple(sites), comments, language, whole, settings, prose
    )
    chosen = default_rules() if rules is None else rules
    found = [
        finding for rule in chosen if rule.code not in quiet for finding in rule.check(scanned)
    ]
    kept, suppressed, unused = apply(found, suppressions(comments))
    # A comment for a rule that was not checked may well be needed.
    codes = {rule.code for rule in chosen}
    known = {rule.code for rule in all_rules()}
    unused = [
        one for one in unused if codes >= (known & {*one.codes} if one.codes else default_codes())
    ]
    for rule in chosen:
        kept += rule.check_unused(unused, scanned)
    return sorted((*kept, *suppressed), key=_order)


def read(
    module: Module, text: Text, path: str, whole: Callable[[], Module] | None = None
) -> list[ReadSite]:
    """Find and read every stopping rule of a module, exact ones too."""
    sites = recognise(evaluate.candidates(module))
    return read_sites(sites, whole or (lambda: module), text, path)


def _order(finding: Finding) -> tuple[str, int, int, str]:
    place = finding.location
    return place.path, place.start_line, place.start_column, finding.code


def _confirmed(
    source: str,
    tree: ast.Module,
    file: SourceFile,
    findings: Sequence[Finding],
    of_code: Collection[str],
) -> FileOutcome:
    """Keep the findings whose place libcst sees too, of those that are of code."""
    coded = [finding for finding in findings if finding.code in of_code]
    if not coded:
        return tuple(findings), ()
    import libcst as cst

    from ransac_fix.scan.form import Span
    from ransac_fix.scan.positions import confirm

    def span(finding: Finding) -> Span:
        place = finding.location
        return Span(place.start_line, place.start_column - 1, place.end_line, place.end_column - 1)

    try:
        nodes = confirm(source, tree, [span(finding) for finding in coded])
    except (cst.ParserSyntaxError, RecursionError):
        # libcst is behind the interpreter's grammar: what ast read stands.
        return tuple(findings), ()

    def stands(finding: Finding) -> bool:
        return finding.code not in of_code or span(finding) in nodes

    kept = tuple(finding for finding in findings if stands(finding))
    errors = tuple(
        _error(file, "two parsers disagree about this line", finding.location.start_line)
        for finding in findings
        if not stands(finding)
    )
    return kept, errors


def _quiet(source: str, rules: Sequence[Rule]) -> frozenset[str]:
    """Give the rules that the text alone says can find nothing, of those that read all of it."""
    lowered = source.encode("utf-8", "replace").lower()
    return frozenset(
        rule.code for rule in rules if rule.reads_everything and not rule.concerns(lowered)
    )


def _scan_cpp(source: str, file: SourceFile, rules: Sequence[Rule], *, gate: bool) -> FileOutcome:
    from ransac_fix.scan import cpp

    code, written = triage.split(source, "c++")
    commented, stated = has_any(source), _may_be_stated(source, written, rules)
    quiet = _quiet(source, rules) if gate else frozenset()
    wanted = commented or stated
    wanted |= any(rule.reads_everything and rule.code not in quiet for rule in rules)
    ruled = not gate or triage.could_hold_a_rule(code)
    if not ruled and not wanted:
        return (), ()
    comments = tuple(cpp.comments(source)) if commented or stated else ()
    text = Text(source)
    module = cpp.parse(source)
    findings = check(
        module if ruled else Module(()),
        text,
        file.path,
        rules,
        whole=lambda: module,
        quiet=quiet,
        comments=comments if commented else (),
        language="c++",
        prose=tuple(blocks(comments, text.lines)) if stated else (),
    )
    return tuple(findings), ()


def _scan_notebook(
    source: str, file: SourceFile, rules: Sequence[Rule], *, gate: bool, settings: Settings
) -> FileOutcome:
    if gate and not file.named:
        # The cells as they stand in the JSON text, but for the ends of their lines.
        cells = _LINE_END.sub("\n", source)
        quiet = _quiet(source, rules)
        wanted = has_any(source) or _may_be_stated(cells, cells, rules)
        wanted |= any(rule.reads_everything and rule.code not in quiet for rule in rules)
        if not wanted and not triage.could_hold_a_rule(cells):
            return (), ()
    try:
        notebook = read_notebook(source)
    except NotANotebook as error:
        return (), (_error(file, str(error)),)
    errors = tuple(
        _error(file, f"code cell {number} cannot be read: {why}") for number, why in notebook.unread
    )
    tree = python.tree(notebook.source)
    module = python.read(tree, notebook.source)
    comments = tuple(python_comments(notebook.source))
    text = Text(notebook.source, [line.cell for line in notebook.lines])
    stated = _may_be_stated(notebook.source, notebook.source, rules)
    findings = check(
        module,
        text,
        file.path,
        rules,
        comments=comments,
        language="notebook",
        settings=settings,
        prose=tuple(python_prose(notebook.source, tree)) if stated else (),
    )
    return tuple(_in_notebook(finding, notebook) for finding in findings), errors


def _in_notebook(finding: Finding, notebook: Notebook) -> Finding:
    def place(location: Location) -> Location:
        start = notebook.lines[location.start_line - 1]
        end = notebook.lines[location.end_line - 1]
        return replace(
            location,
            start_line=start.json_line,
            end_line=end.json_line,
            cell=Cell(start.cell, start.line),
        )

    related = tuple(Related(place(one.location), one.message) for one in finding.related)
    fix, no_fix = finding.fix, finding.no_fix
    if fix is not None:
        edits = tuple(notebook.edit(one) for one in fix.edits)
        known = tuple(one for one in edits if one is not None)
        if len(known) == len(edits):
            fix = replace(fix, edits=known)
        else:
            fix, no_fix = None, "its cell is not Python 3 as it stands"
    return replace(
        finding, location=place(finding.location), related=related, fix=fix, no_fix=no_fix
    )


def _error(file: SourceFile, message: str, line: int | None = None) -> ScanError:
    return ScanError(file.path, message, line, named=file.named)

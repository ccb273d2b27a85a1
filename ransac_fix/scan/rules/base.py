"""What a rule is: one file with its code, name, message, examples and pages.

A rule is a class in a file of its own in this folder. Its docstring is its page of the
documentation, its examples are its tests, and its attributes are what reports and SARIF say of
it; a rule without them cannot be loaded.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from ransac_fix.scan.findings import Certainty, Finding, Fix, FixStyle, Location, Related
from ransac_fix.scan.fixes import callee_of, fix_probability
from ransac_fix.scan.form import Module, Span
from ransac_fix.scan.prose import Prose
from ransac_fix.scan.reading import ReadSite, Text
from ransac_fix.scan.source import Source, source_of
from ransac_fix.scan.suppressions import Comment, Suppression


@dataclass(frozen=True, slots=True)
class Settings:
    """What the user chose.

    Attributes
    ----------
    fix_style : {"self-contained", "import"}
        Whether a fix adds a function to the file or imports this package's.
    python : str or None
        The interpreter whose environment the files run in; this one by default.
    """

    fix_style: FixStyle = "self-contained"
    python: str | None = None


DEFAULTS = Settings()


@dataclass(frozen=True, slots=True, eq=False)
class ScannedFile:
    """One file as rules see it.

    Attributes
    ----------
    path : str
    text : Text
    module : Module
        The small form of the file.
    sites : tuple of ReadSite
        Every stopping rule of the file, exact ones too.
    comments : tuple of Comment
        Its comments; read only where one could set a finding aside.
    language : str
        "python", "notebook", "c++", or "python 2" for what had to be repaired to be read.
    whole : callable or None
        Gives the whole file, where ``module`` is only the part that could hold a stopping rule.
    settings : Settings
    prose : tuple of Prose
        Its docstrings and comments; read only where one could state a stopping rule.
    """

    path: str
    text: Text
    module: Module
    sites: tuple[ReadSite, ...]
    comments: tuple[Comment, ...] = ()
    language: str = "python"
    whole: Callable[[], Module] | None = None
    settings: Settings = DEFAULTS
    prose: tuple[Prose, ...] = ()

    def source(self) -> Source | str:
        """Give the file as fixes read it, or say why it cannot be fixed."""
        return source_of(self.text, self.language, self.path, self.settings.fix_style)

    def everything(self) -> Module:
        """Give the whole file in the small form; ``module`` may be the part that matters."""
        return self.module if self.whole is None else self.whole()

    def location(self, span: Span) -> Location:
        """Give a span as a location of this file."""
        return Location(self.path, span.line, span.column + 1, span.end_line, span.end_column + 1)


class Rule(ABC):
    """One rule. The docstring of a subclass is its page."""

    code: ClassVar[str]
    """Its code, such as ``RFX001``."""

    name: ClassVar[str]
    """Its name, read as "allow <name>"."""

    summary: ClassVar[str]
    """What it finds, in one line."""

    valid: ClassVar[Mapping[str, str]]
    """Code that it must leave alone, each under a sentence that says why."""

    invalid: ClassVar[Mapping[str, str]]
    """Code that it must find, each under a sentence that says what is special about it."""

    cpp_valid: ClassVar[Mapping[str, str]] = {}
    """As ``valid``, in C++."""

    cpp_invalid: ClassVar[Mapping[str, str]] = {}
    """As ``invalid``, in C++."""

    default: ClassVar[bool] = True
    """Whether it is checked unless asked for; others depend on more than the file itself."""

    reads_everything: ClassVar[bool] = False
    """Whether it looks at more than stopping rules; it is checked only where it ``concerns``."""

    about_code: ClassVar[bool] = True
    """Whether what it finds is code; others find comments."""

    reads_prose: ClassVar[bool] = False
    """Whether it reads the ``prose`` of a file."""

    @abstractmethod
    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the places of a file where the rule is broken."""

    def concerns(self, lowered: bytes) -> bool:
        """Whether a file, in lower case, could break a rule that reads everything."""
        del lowered
        return False

    def needs(self) -> tuple[bytes, ...]:
        """Give words, in lower case, one of which stands in every file that such a rule concerns.

        Where there are none the rule is asked about every file, which takes its time.
        """
        return ()

    def check_unused(self, unused: Iterable[Suppression], file: ScannedFile) -> Iterator[Finding]:
        """Find fault with the comments that set nothing aside; one rule does."""
        del unused, file
        return iter(())


class SiteRule(Rule):
    """A rule about sites: places that compute or test a number of trials."""

    @abstractmethod
    def applies(self, read: ReadSite) -> bool:
        """Whether a site with an approximate probability breaks this rule."""

    @abstractmethod
    def message(self, read: ReadSite) -> str:
        """Say what is wrong at a site, in one line."""

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the sites that this rule is about."""
        for read in file.sites:
            certainty = read.certainty
            if certainty is None or read.site.probability.kind != "approximate":
                continue
            if self.applies(read):
                fix = self.fix(read, file)
                yield Finding(
                    self.code,
                    file.location(read.site.span),
                    self.certainty(read, certainty),
                    self.message(read),
                    dict(read.roles),
                    " ".join(read.expression.split()),
                    tuple(self.related(read, file)),
                    None if isinstance(fix, str) else fix,
                    fix if isinstance(fix, str) else "",
                    callee=callee_of(read) if isinstance(fix, str) else "",
                )

    def certainty(self, read: ReadSite, certainty: Certainty) -> Certainty:
        """Adjust how sure a site is to be one, for this rule."""
        del read
        return certainty

    def fix(self, read: ReadSite, file: ScannedFile) -> Fix | str:
        """Give the change that mends a site, or say why there is none."""
        source = file.source()
        return source if isinstance(source, str) else fix_probability(read, source, file.path)

    def related(self, read: ReadSite, file: ScannedFile) -> Iterator[Related]:
        """Give the other places that belong to a site."""
        if read.site.used != read.site.span:
            yield Related(file.location(read.site.used), "the loop tests it here")


def power_of(read: ReadSite) -> str:
    """Spell the power of a site: ``w**k`` in its own names."""
    return power_in(read.roles)


def power_in(roles: Mapping[str, str]) -> str:
    """Spell the power of named roles."""
    ratio = roles.get("inlier_ratio", "w")
    size = roles.get("sample_size", "k")
    return f"{_grouped(ratio)}**{_grouped(size)}"


def product_of(read: ReadSite) -> str:
    """Spell the exact probability of a site in its own names, as binomial coefficients."""
    return product_in(read.roles)


def product_in(roles: Mapping[str, str]) -> str:
    """Spell the exact probability in named roles."""
    size = roles.get("sample_size", "k")
    short = size not in ("I", "n")
    inliers = roles.get("n_inliers", "I" if short else "n_inliers")
    samples = roles.get("n_samples", "n" if short else "n_samples")
    return f"C({inliers}, {size}) / C({samples}, {size})"


def _grouped(text: str) -> str:
    plain = text.replace("_", "").replace(".", "").replace("self", "")
    return text if plain.isalnum() else f"({text})"

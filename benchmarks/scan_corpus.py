"""Measure the scan on labelled sites of public repositories.

    python benchmarks/scan_corpus.py CORPUS.tsv MIRROR [--folds 5]

CORPUS.tsv has the columns repo, commit, path, line_start, line_end, language, label, form, note,
and perhaps ``set``; ``benchmarks/scan_fresh.tsv``, ``benchmarks/scan_blind.tsv`` and
``benchmarks/scan_blind3.tsv`` are three, of sites that the recogniser was not written against:
``open`` sites were read first and what was missed in them then mended, ``held-out`` ones were read
after that. The sites of the second and third were labelled before any scan of them. In the third,
``copy`` marks code of which a line stood in repositories seen before, and ``other file`` rules
whose power stands in another file.
MIRROR holds one git directory a repository, ``owner+name/repo`` (bare or with ``.git``).

Labels: ``approx`` a rule with the power, ``exact`` one with the product, ``fixed`` RANSAC code
without a rule, ``negative`` a look-alike. Every approximate site of a listed file has a row, so
any other finding in these files is false. The recogniser has nothing to train, so the folds, by
repository, only show how far the figures depend on which repositories were looked at.
"""

import argparse
import csv
import subprocess
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.findings import Finding
from ransac_fix.scan.scanner import decode, scan_data, scan_source

RULES = ("RFX001", "RFX002", "RFX003")
_MISREAD = (("apriori", "RFX001"), ("adaptive", "RFX002"))
Row = dict[str, str]


def git_directory(mirror: Path, repo: str) -> Path:
    folder = mirror / repo.replace("/", "+") / "repo"
    return folder / ".git" if (folder / ".git").exists() else folder


def content(mirror: Path, row: Row) -> bytes:
    place = f"{row['commit']}:{row['path']}"
    command = ["git", "--git-dir", str(git_directory(mirror, row["repo"])), "show", place]
    return subprocess.run(command, capture_output=True, check=True).stdout


def overlaps(finding: Finding, row: Row) -> bool:
    place = finding.location
    return place.start_line <= int(row["line_end"]) and place.end_line >= int(row["line_start"])


def codes(findings: Iterable[Finding]) -> str:
    return " ".join(f"{one.code}:{one.location.start_line}" for one in findings) or "nothing"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("mirror", type=Path)
    parser.add_argument("--folds", type=int, default=5)
    options = parser.parse_args()
    with options.corpus.open(newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    files: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        files[row["repo"], row["commit"], row["path"]].append(row)

    def groups(row: Row) -> list[str]:
        fold = f"fold {zlib.crc32(row['repo'].encode()) % options.folds}"
        return [name for name in (fold, row["language"], row.get("set")) if name]

    total: Counter[str] = Counter()
    parts: dict[str, Counter[str]] = defaultdict(Counter)
    samplers: Counter[str] = Counter()
    certainties: Counter[str] = Counter()
    for (repo, _, path), sites in files.items():
        data = content(options.mirror, sites[0])
        language = LANGUAGES[PurePosixPath(path).suffix.lower()]
        source = decode(data, language)
        found, errors = scan_source(source, SourceFile(path, language, named=True))
        # The gates must lose nothing: neither a finding nor what it says.
        ungated, _ = scan_source(source, SourceFile(path, language, named=True), gate=False)
        gated = scan_data(data, SourceFile(path, language, named=False)).findings
        if not found == ungated == gated:
            total["gates"] += 1
            print(f"GATES    {repo} {path}: {codes(gated)}, without them {codes(ungated)}")
        found = tuple(finding for finding in found if finding.code in RULES)
        counts: Counter[str] = Counter(files=1, unread=len(errors))
        for error in errors:
            print(f"UNREAD   {repo} {path}:{error.line}: {error.message}")
        matched: set[int] = set()
        for row in sites:
            hits = [number for number, one in enumerate(found) if overlaps(one, row)]
            matched.update(hits if row["label"] == "approx" else [])
            counts[f"rows {row['label']}"] += 1
            if row["label"] == "approx":
                outcome = "found" if hits else "missed"
                counts[outcome] += 1
                for name in groups(row):
                    parts[name][outcome] += 1
                if not hits:
                    print(f"MISSED   {repo} {path}:{row['line_start']} ({row['form']})")
                drawn = row["note"].partition("sampler=")[2].split(";")[0].split("(")[0]
                for number in hits:
                    certainties[found[number].certainty] += 1
                    read = "with" if found[number].code == "RFX003" else "not with"
                    samplers[f"sampler {drawn or 'unknown'}, read {read}"] += 1
                    mode = row["note"].partition("mode=")[2].split(";")[0].split("(")[0]
                    if read == "not with":
                        samplers[f"{mode}, read as {found[number].code}"] += 1
                    if (mode, found[number].code) in _MISREAD:
                        print(f"MODE     {repo} {path}:{row['line_start']}: {mode}")
                    if drawn and (read == "with") != (drawn == "with"):
                        print(f"SAMPLER  {repo} {path}:{row['line_start']}: {drawn}, read {read}")
        for number, finding in enumerate(found):
            if number not in matched:
                counts["false"] += 1
                for name in groups(sites[0]):
                    parts[name]["false"] += 1
                print(f"FALSE    {repo} {path}:{finding.location.start_line}: {finding.code}")
        total.update(counts)

    print(f"{'':10}{'found':>7}{'missed':>8}{'false':>7}{'recall':>9}{'precision':>11}")
    for name, counts in [*sorted(parts.items()), ("all", total)]:
        found_count, missed, false = counts["found"], counts["missed"], counts["false"]
        recall = found_count / max(1, found_count + missed)
        precision = found_count / max(1, found_count + false)
        row_text = f"{name:10}{found_count:7}{missed:8}{false:7}{recall:9.3f}{precision:11.3f}"
        print(row_text)
    for label in ("approx", "exact", "fixed", "negative"):
        print(f"rows {label}: {total[f'rows {label}']}")
    print(f"files: {total['files']}, unread: {total['unread']}")
    print(f"files in which the gates change something: {total['gates']}")
    for name, count in sorted(certainties.items()) + sorted(samplers.items()):
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()

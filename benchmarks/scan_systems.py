"""Whether the scan reads the rules of the known systems as they are.

    python benchmarks/scan_systems.py MIRROR [--tree SYSTEM=FOLDER]...

MIRROR holds one git directory a repository, ``owner+name/repo``; the newest commit is read. A
system without one can be given as a folder of its sources. For each site that ``systems.toml``
lists, the table says what stands there by the scan.
"""

import argparse
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from ransac_fix.scan import cpp, python
from ransac_fix.scan.files import LANGUAGES
from ransac_fix.scan.reading import ReadSite, Text
from ransac_fix.scan.scanner import decode, read
from ransac_fix.systems import load_systems

EXPECTED = {"approximate": {"approximate"}, "exact": {"exact"}}


def git_directory(mirror: Path, repo: str) -> Path:
    folder = mirror / repo.replace("/", "+") / "repo"
    return folder / ".git" if (folder / ".git").exists() else folder


def sources(
    mirror: Path, upstream: str, tree: Path | None, path: str, revision: str = "HEAD"
) -> Iterator[tuple[str, bytes]]:
    """Yield the file of a site, wherever it has moved to under its own name."""
    name = PurePosixPath(path).name
    if tree is not None:
        for found in sorted(tree.rglob(name)):
            yield str(found.relative_to(tree)), found.read_bytes()
        return
    directory = git_directory(mirror, upstream)
    if not directory.exists():
        return
    git = ["git", "--git-dir", str(directory)]
    listed = subprocess.run(
        [*git, "ls-tree", "-r", "--name-only", revision], capture_output=True, text=True
    )
    paths = listed.stdout.splitlines()
    same = [path] if path in paths else [one for one in paths if PurePosixPath(one).name == name]
    for one in same:
        shown = subprocess.run([*git, "show", f"{revision}:{one}"], capture_output=True)
        yield one, shown.stdout


def sites_of(path: str, data: bytes) -> tuple[list[ReadSite], Text]:
    language = LANGUAGES[PurePosixPath(path).suffix.lower()]
    source = decode(data, language)
    module = cpp.parse(source) if language == "c++" else python.parse(source)
    text = Text(source)
    return read(module, text, path), text


def matches(found: ReadSite, symbol: str) -> bool:
    """Whether a site stands in the named function; a few words name the whole file."""
    name = symbol.replace("::", ".").rpartition(".")[2].removesuffix("()")
    function = found.site.function
    return " " in symbol or (function is not None and name in (function.name, function.owner))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mirror", type=Path)
    parser.add_argument("--tree", action="append", default=[], metavar="SYSTEM=FOLDER")
    options = parser.parse_args()
    trees = {name: Path(folder) for name, _, folder in (one.partition("=") for one in options.tree)}
    total: Counter[str] = Counter()
    for system in load_systems():
        for site in system.sites:
            if PurePosixPath(site.path).suffix.lower() not in LANGUAGES:
                continue
            files = list(
                sources(options.mirror, system.upstream, trees.get(system.name), site.path)
            )
            kinds: list[str] = []
            for path, data in files:
                found, _ = sites_of(path, data)
                kinds += [
                    f"{one.site.probability.kind}:{one.site.span.line}"
                    for one in found
                    if matches(one, site.symbol)
                ]
            wanted = EXPECTED.get(system.stopping)
            read_kinds = {kind.partition(":")[0] for kind in kinds}
            if not files:
                verdict = "no source"
            elif wanted is None:
                verdict = "other rule"
            elif read_kinds and not wanted & read_kinds:
                verdict = "read else"  # upstream may have changed since the release
            else:
                verdict = "as known" if read_kinds else "MISSED"
            total[verdict] += 1
            print(
                f"{system.name:16}{system.stopping:13}{verdict:11}"
                f"{PurePosixPath(site.path).name}: {site.symbol}  {', '.join(kinds)}"
            )
    print(dict(total))


if __name__ == "__main__":
    main()

"""From paths to files: .gitignore, excludes, named paths, links, what cannot be read."""

import os
from pathlib import Path

import pytest

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.files import find_files


def tree(root: Path, *files: str, **written: str) -> None:
    for name in files:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    for name, text in written.items():
        (root / name).write_text(text)


def found(root: Path, *paths: Path, **options) -> list[str]:
    return [
        os.path.relpath(file.path, root)
        for file in find_files([os.fspath(path) for path in paths or (root,)], **options)
    ]


def ignore(folder: Path, *lines: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".gitignore").write_text("\n".join(lines))


def test_takes_python_and_notebooks_in_order(tmp_path):
    tree(tmp_path, "b.py", "a/z.py", "a/c.ipynb", "d.txt", "e.PY")
    assert found(tmp_path) == ["b.py", "e.PY", "a/c.ipynb", "a/z.py"]


def test_a_gitignore_holds_below_its_folder(tmp_path):
    tree(tmp_path, "a.py", "gen.py", "sub/gen.py", "build/x.py")
    ignore(tmp_path, "gen.py", "build/")
    assert found(tmp_path) == ["a.py"]
    assert len(found(tmp_path, respect_gitignore=False)) == 4


def test_a_nested_gitignore_says_more_and_takes_back(tmp_path):
    tree(tmp_path, "gen_a.py", "sub/gen_b.py", "sub/keep_gen.py", "sub/old.py")
    ignore(tmp_path, "*gen*.py")
    ignore(tmp_path / "sub", "!keep_gen.py", "old.py")
    assert found(tmp_path) == ["sub/keep_gen.py"]


def test_patterns_are_anchored_at_their_own_file(tmp_path):
    tree(tmp_path, "x.py", "sub/x.py", "sub/deep/x.py")
    ignore(tmp_path / "sub", "/x.py")
    assert found(tmp_path) == ["x.py", "sub/deep/x.py"]


def test_a_gitignore_above_a_named_folder_holds_in_a_repository(tmp_path):
    tree(tmp_path, "sub/a.py", "sub/gen.py")
    ignore(tmp_path, "gen.py")
    assert found(tmp_path, tmp_path / "sub") == ["sub/a.py", "sub/gen.py"]
    (tmp_path / ".git").mkdir()
    assert found(tmp_path, tmp_path / "sub") == ["sub/a.py"]


def test_a_named_folder_is_scanned_even_if_ignored_or_excluded(tmp_path):
    tree(tmp_path, ".venv/lib/site-packages/a.py", "out/b.py")
    ignore(tmp_path, "out/", ".venv")
    (tmp_path / ".git").mkdir()
    assert found(tmp_path) == []
    assert found(tmp_path, tmp_path / "out") == ["out/b.py"]
    assert found(tmp_path, tmp_path / ".venv" / "lib" / "site-packages") == [
        ".venv/lib/site-packages/a.py"
    ]
    # The default excludes hold again below it.
    assert found(tmp_path, tmp_path / ".venv") == []


def test_a_named_file_is_scanned_even_if_ignored(tmp_path):
    tree(tmp_path, "venv/a.py")
    ignore(tmp_path, "*.py")
    files = list(find_files([os.fspath(tmp_path / "venv" / "a.py")]))
    assert [file.named for file in files] == [True]


def test_each_file_comes_once(tmp_path):
    tree(tmp_path, "a.py")
    (tmp_path / "link.py").symlink_to(tmp_path / "a.py")
    assert found(tmp_path, tmp_path / "a.py", tmp_path, tmp_path) == ["a.py"]


def test_links_to_folders_are_not_followed(tmp_path):
    tree(tmp_path, "sub/a.py")
    (tmp_path / "sub" / "loop").symlink_to(tmp_path, target_is_directory=True)
    assert found(tmp_path) == ["sub/a.py"]


def test_a_broken_link_is_no_file(tmp_path):
    (tmp_path / "gone.py").symlink_to(tmp_path / "nowhere.py")
    assert found(tmp_path) == []


def test_an_unreadable_folder_is_reported(tmp_path, monkeypatch):
    tree(tmp_path, "a.py", "sub/b.py")
    real = os.scandir

    def scandir(path):
        if str(path).endswith("sub"):
            raise PermissionError(13, "Permission denied")
        return real(path)

    monkeypatch.setattr("os.scandir", scandir)
    errors = []
    assert found(tmp_path, on_error=errors.append) == ["a.py"]
    assert [(Path(error.path).name, error.message) for error in errors] == [
        ("sub", "cannot be read: Permission denied")
    ]


def test_more_excludes(tmp_path):
    tree(tmp_path, "a.py", "tests/b.py", "gen/c.py")
    assert found(tmp_path, excludes=("tests", "gen/*.py")) == ["a.py"]


@pytest.mark.parametrize("name", ["nowhere.py", "text.txt", ""])
def test_what_cannot_be_scanned_is_one_clear_error(tmp_path, name):
    tree(tmp_path, "text.txt")
    path = os.fspath(tmp_path / name) if name else ""
    with pytest.raises(RansacFixError, match="cannot scan"):
        list(find_files([path]))

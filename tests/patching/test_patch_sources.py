"""The digest of the sources of a patch changes with each of them."""

from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ransac_fix.patches.opencv
from ransac_fix import criterion
from ransac_fix.digests import digest_of_files
from ransac_fix.errors import RansacFixError
from ransac_fix.patching import missing, sources
from ransac_fix.patching.sources import sources_digest


@pytest.fixture(autouse=True)
def fresh():
    sources_digest.cache_clear()
    yield
    sources_digest.cache_clear()


def test_the_patch_what_it_is_made_with_and_the_rule_are_digested(monkeypatch):
    seen = []
    monkeypatch.setattr(sources, "digest_of_files", lambda files: seen.extend(files) or "digest")
    assert sources_digest("cv2") == "digest"
    for module in (ransac_fix.patches.opencv, missing, criterion):
        assert Path(module.__file__) in seen
    assert [path.name for path in seen if path.parent.name == "patches"] == ["opencv.py"]


def test_a_change_of_the_patch_changes_the_digest(monkeypatch, tmp_path):
    file = tmp_path / "opencv.py"
    monkeypatch.setattr(sources, "find_spec", lambda name: ModuleSpec(name, None, origin=str(file)))
    found = []
    for content in ("a = 1", "a = 2", "a = 1"):
        file.write_text(content, "utf-8")
        sources_digest.cache_clear()
        found.append(sources_digest("opencv"))
    assert found[0] == found[2] != found[1]


def test_an_unknown_name_is_an_error():
    with pytest.raises(RansacFixError, match="there is no patch for 'nothing'"):
        sources_digest("nothing")


FILES = st.dictionaries(st.sampled_from("abcd"), st.binary(max_size=8), max_size=4)


@given(FILES, FILES)
def test_only_the_same_files_have_the_same_digest(tmp_path_factory, one, other):
    def digest(files):
        folder = tmp_path_factory.mktemp("files")
        for name, content in files.items():
            (folder / name).write_bytes(content)
        return digest_of_files(sorted(folder.iterdir()))

    assert (digest(one) == digest(other)) == (one == other)

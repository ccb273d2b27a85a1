"""Nothing that is scanned can crash the scan, or make it hang."""

import gc
import os
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.scan import scan_paths
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.notebook import NotANotebook, read_notebook
from ransac_fix.scan.repair import repair
from ransac_fix.scan.rules import all_rules
from ransac_fix.scan.scanner import scan_source

EXAMPLES = [text for rule in all_rules() for text in (*rule.invalid.values(), *rule.valid.values())]
PYTHON = SourceFile("ransac.py", "python", named=True)
NOISE = [
    "",
    "(",
    ")",
    ":",
    "\n",
    "\t",
    "    ",
    "'''",
    "\\",
    "\x00",
    "\ud800",
    "**",
    "lambda",
    "\f",
    "%",
]


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_changed_source_never_crashes(data):
    source = data.draw(st.sampled_from(EXAMPLES))
    start = data.draw(st.integers(0, len(source)))
    end = data.draw(st.integers(start, min(len(source), start + 30)))
    noise = data.draw(st.sampled_from(NOISE))
    scan_source(source[:start] + noise + source[end:], PYTHON, gate=False)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=300))
def test_bytes_never_crash(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("bytes")
    for name in ("a.py", "a.ipynb", "a.cpp"):
        (folder / name).write_bytes(b"# ransac log(1 - w**k)\n" + data)
    scan_paths([folder])


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("latin.py", b"# caf\xe9 ransac log(1-w**k)\n", "cannot be decoded"),
        ("coding.py", b"# coding: nonsense\n# ransac log(1-w**k)\n", "cannot be decoded"),
        ("undefined.py", b"# coding: undefined\n# ransac log(1-w**k)\n", "cannot be decoded"),
        ("hex.py", b"# coding: hex\n# ransac log(1-w**k)\n", "cannot be decoded"),
        ("null.py", b"x = '\x00'  # ransac log(1-w**k)\n", "not Python that can be read"),
        ("broken.py", b"def ransac(:\n    log(1-w**k)\n", "not Python that can be read"),
        ("deep.py", b"x = " + b"(" * 5000 + b"log(1-w**k)" + b")" * 5000 + b"  # ransac\n", ""),
        ("cut.ipynb", b'{"cells": [ransac log(1-w**k', "not a notebook"),
        ("list.ipynb", b'["ransac log(1-w**k)"]', "not a notebook"),
    ],
)
def test_what_cannot_be_read_is_reported(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    result = scan_paths([tmp_path])
    assert not result.findings
    (error,) = result.errors
    assert message in error.message
    assert not error.named
    assert scan_paths([tmp_path / name]).errors[0].named


def test_an_unreadable_file_is_reported(tmp_path, monkeypatch):
    path = tmp_path / "a.py"
    path.write_text("x")
    real = open

    def refuse(file, *args, **options):
        if os.fspath(file) == str(path):
            raise PermissionError(13, "Permission denied")
        return real(file, *args, **options)

    monkeypatch.setattr("builtins.open", refuse)
    (error,) = scan_paths([tmp_path]).errors
    assert error.message == "cannot be read: Permission denied"


PYTHON2 = """
import math
print 'ransac'
print >>sys.stderr, "a", x
exec "code"
try:
    pass
except ValueError, error:
    raise KeyError, "k"
n = 0777 + 10L
if n <> 3: print n
def trials(w, k, s):
\tif w:
\t\tprint "w = %f" % w
\treturn math.log(1 - s) / math.log(1 - w**k)
"""


def test_python_2_is_read():
    (finding,), errors = scan_source(PYTHON2, PYTHON)
    assert not errors
    assert finding.code == "RFX001"
    assert finding.location.start_line == 15
    assert finding.fix is None


def test_python_2_with_tabs_among_spaces_is_read():
    source = (
        "import math\ndef ransac(w, k, s):\n\tfor i in range(3):\n\t\tprint i\n"
        "        N = math.log(1 - s) / math.log(1 - w**k)\n        return N\n"
    )
    (finding,), errors = scan_source(source, PYTHON)
    assert not errors
    assert finding.location.start_line == 5


def test_what_is_repaired_keeps_its_lines():
    text = repair(PYTHON2)
    assert text is not None
    assert len(text.split("\n")) == len(PYTHON2.split("\n"))
    assert repair("def f(:\n    pass\n") is None


RULE = "N = log(1 - s) / log(1 - w**k)"
START = "from math import log\ndef ransac(w, k, s):\n"
BROKEN = {
    "a statement": f"here be dragons\n{START}    {RULE}\n",
    "a call left open": f"print('a'\n{START}    {RULE}\n",
    "a header": f"{START.replace(')', '')}    {RULE}\n    return N\n",
    "an empty block": f"{START}    if w:\n    {RULE}\n    return N\n",
    "a block too deep": f"{START}    v = 1\n        {RULE}\n        v = 2\n",
    "a block not deep enough": f"{START}    v = 1\n  {RULE}\n",
    "a conflict": f"{START}<<<<<<< HEAD\n    {RULE}\n=======\n>>>>>>> b\n",
}


@pytest.mark.parametrize("source", BROKEN.values(), ids=BROKEN.keys())
def test_what_cannot_be_read_costs_a_few_lines(source):
    (finding,), (error,) = scan_source(source, PYTHON)
    assert finding.code in ("RFX001", "RFX002")
    assert RULE in source.splitlines()[finding.location.start_line - 1]
    assert finding.fix is None
    assert finding.no_fix == "the file cannot be read whole"
    assert error.code == "RFX900"


NOTEBOOK = """{
 "cells": [
  {"cell_type": "markdown", "source": ["# ransac: log(1-s)/log(1-w**k)\\n"]},
  {"cell_type": "code", "source": [
    "%matplotlib inline\\n",
    "!pip install numpy\\n",
    "import numpy as np\\n",
    "k = 4"
   ]},
  {"cell_type": "code", "source": ["%%bash\\n", "echo ransac ("]},
  {"cell_type": "code", "source": ["this is no code"]},
  {"cell_type": "code", "source": [
    "%%time\\n",
    "def ransac_trials(w, s):\\n",
    "    files = !ls\\n",
    "    return np.log(1 - s) / np.log(1 - w**k)"
   ]}
 ],
 "metadata": {"kernelspec": {"language": "python"}},
 "nbformat": 4
}
"""


def test_notebooks_are_read_cell_by_cell(tmp_path):
    path = tmp_path / "a.ipynb"
    path.write_text(NOTEBOOK)
    result = scan_paths([path])
    (finding,) = result.findings
    place = finding.location
    assert NOTEBOOK.splitlines()[place.start_line - 1].strip().startswith('"    return np.log(')
    assert place.cell is not None
    assert (place.cell.index, place.cell.line) == (4, 4)
    (error,) = result.errors
    assert error.message.startswith("code cell 3 cannot be read: line 1")


def test_a_module_written_by_a_cell_is_read(tmp_path):
    path = tmp_path / "a.ipynb"
    path.write_text(NOTEBOOK.replace("%%time", "%%writefile trials.py"))
    assert [one.code for one in scan_paths([path]).findings] == ["RFX001"]
    path.write_text(NOTEBOOK.replace("%%time", "%%writefile trials.txt"))
    assert not scan_paths([path]).findings


def test_a_cell_that_is_no_python_costs_a_few_lines(tmp_path):
    path = tmp_path / "a.ipynb"
    path.write_text(NOTEBOOK.replace("files = !ls", "files are many"))
    result = scan_paths([path])
    (finding,) = result.findings
    assert finding.location.cell.index == 4
    assert finding.fix is None
    assert [one.message[:26] for one in result.errors] == [
        "code cell 3 cannot be read",
        "code cell 4 cannot be read",
    ]


def test_a_notebook_in_another_language_is_not_read():
    with pytest.raises(NotANotebook, match="its language is julia"):
        read_notebook(NOTEBOOK.replace('"python"', '"julia"'))


@pytest.mark.parametrize(
    "source",
    [
        "x = 1\n" + "x = x * x + x / (x - 1)\n" * 400 + "ransac = log(x) / log(1 - x**x)\n",
        "def ransac(a):\n"
        + "".join(f"    if a > {i}:\n        a = a * {i}\n" for i in range(400))
        + "    return log(a) / log(1 - a**a)\n",
        "".join(f"def f{i}(x): return f{i + 1}(x * x) * f{i + 1}(x)\n" for i in range(60))
        + "def f60(x): return x**3\nransac = log(.1) / log(1 - f0(2))\n",
        "def ransac(x):\n"
        + "".join("    " * i + "    for i in y:\n" for i in range(18))
        + "    " * 19
        + "x = x * x; N = log(x) / log(1 - x**2)\n",
        "ransac = " + " + ".join(["log(.1) / log(1 - w**k)"] * 300) + "\n",
    ],
    ids=["long chain", "many branches", "doubling calls", "deep loops", "long sum"],
)
def test_cost_stays_bounded(source):
    start = time.process_time()
    scan_source(source, PYTHON, gate=False)
    assert time.process_time() - start < 20


def test_what_was_read_of_a_file_is_freed_with_the_collector_off():
    source = "def ransac(w, k):\n    return log(0.01) / log(1 - w**k)\n"
    gc.collect()
    gc.disable()
    try:
        findings, _ = scan_source(source, PYTHON)
        left = {type(one).__name__ for one in gc.get_objects()}
    finally:
        gc.enable()
    assert findings
    assert not left & {"_Evaluator", "Nodes", "_File"}


def test_a_large_file_is_skipped_with_its_reason(tmp_path: Path):
    (tmp_path / "big.py").write_bytes(b"# ransac log(1-w**k)\n" + b"#" * 20_000_001)
    (error,) = scan_paths([tmp_path]).errors
    assert error.message == "skipped: larger than 20 MB"

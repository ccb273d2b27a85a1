"""Fixes of C, C++ and CUDA: they compile, and are exact by execution."""

import ctypes
import math
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from ransac_fix import all_inlier_probability
from ransac_fix.cli import cli
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.scanner import scan_source

# Each defines `double trials(int n_inliers, int n_samples, int sample_size, double confidence)`
# with C linkage, for ransac.
FORMS = {
    "plain.c": """
#include <math.h>

double trials(int n_inliers, int n_samples, int sample_size, double confidence)
{
    double w = (double) n_inliers / n_samples;
    return log(1 - confidence) / log(1 - pow(w, sample_size));
}
""",
    "floats.c": """
#include <math.h>

static float power(int n_inliers, int n_samples, int k)
{
    float w = n_inliers / (float) n_samples;
    return 1 - powf(w, (float) k);
}

double trials(int n_inliers, int n_samples, int sample_size, double confidence)
{
    return log(1 - confidence) / log(power(n_inliers, n_samples, sample_size));
}
""",
    "no_header.c": """double log(double), pow(double, double);
/* what ransac takes */
double trials(int n_inliers, int n_samples, int sample_size, double confidence)
{
    return log(1 - confidence) / log(1 - pow(1.0 * n_inliers / n_samples, sample_size));
}
""",
    "clamped.cpp": """
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace {
struct Model {
  std::vector<int> inliers_;
};
}  // namespace

namespace sac {
static double required(const Model& model, std::size_t n, std::size_t k, double confidence) {
  // Update the number of trials
  double w = static_cast<double>(model.inliers_.size()) / static_cast<double>(n);
  double p_no_outliers = 1.0 - pow(w, static_cast<double>(k));
  p_no_outliers = (std::max)(std::numeric_limits<double>::epsilon(), p_no_outliers);
  p_no_outliers = (std::min)(1.0 - std::numeric_limits<double>::epsilon(), p_no_outliers);
  return std::log(1.0 - confidence) / std::log(p_no_outliers);
}
}  // namespace sac

extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  Model model;
  model.inliers_.resize(n_inliers);
  return sac::required(model, n_samples, sample_size, confidence);
}
""",
    "unsigned_float_deduced.cpp": """
#include <algorithm>
#include <cmath>

template <typename T>
T ransac_trials(unsigned n_inliers, unsigned n_samples, T k, T log_miss) {
  const T w = static_cast<T>(n_inliers) / n_samples;
  return log_miss / std::log(std::max(static_cast<T>(1e-12), 1 - std::pow(w, static_cast<T>(k))));
}

extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  return ransac_trials<double>(n_inliers, n_samples, sample_size, std::log(1 - confidence));
}
""",
    "float_bounds.cpp": """
#include <algorithm>
#include <cmath>

static float ransac_miss(int n_inliers, int n_samples, int k) {
  float w = float(n_inliers) / n_samples;
  // std::max wants two of the same type
  return std::log(std::max(1e-30f, 1.f - std::pow(w, float(k))));
}

extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  return std::log(1 - confidence) / ransac_miss(n_inliers, n_samples, sample_size);
}
""",
    "product.hpp": """#include <cmath>
inline double ransac_line_trials(size_t inliers, size_t total, double s) {
\tconst double e = 1.0 - double(inliers) / total;
\treturn std::log(1. - s) / std::log(1. - (1. - e) * (1. - e));
}
extern "C" inline double trials(int n_inliers, int n_samples, int sample_size, double s) {
\treturn sample_size == 2 ? ransac_line_trials(n_inliers, n_samples, s) : -1;
}
extern "C" double (*const used)(int, int, int, double);
double (*const used)(int, int, int, double) = trials;
""",
    "reciprocal.cc": """
#if defined(_MSC_VER)
#include <intrin.h>
#endif
#include <cmath>

extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  // of msac
  const double log_probability = std::log(1.0 - confidence);
  const double one_over_indices = 1.0 / static_cast<double>(n_samples);
  double k = 0;
  for (int i = 0; i < 1; ++i) {
    const double w = static_cast<double>(n_inliers) * one_over_indices;
    k = log_probability / std::log(1.0 - std::pow(w, static_cast<double>(sample_size)));
  }
  return k;
}
""",
    "size_of_its_own.cpp": """
#include <cmath>
struct Estimator { int size; int sampleSize() const { return size; } };
static double magsac_trials(const Estimator& estimator, int inliers, int points, double s) {
  const int sample_size = estimator.sampleSize();
  const double w = double(inliers) / points;
  return std::log(1. - s) / std::log(1. - std::pow(w, sample_size));
}
extern "C" double trials(int n_inliers, int n_samples, int sample_size, double s) {
  return magsac_trials({sample_size}, n_inliers, n_samples, s);
}
""",
    "threaded.cpp": """
#include <cmath>

namespace {

double RequiredTrials(double confidence, double inlier_ratio,
                      int k);

// One helper for all ransac variants.
double RequiredTrials(double confidence, double inlier_ratio, int k) {
  if (inlier_ratio <= 0.0) return -1.0;
  return std::log(1.0 - confidence) / std::log(1.0 - std::pow(inlier_ratio, k));
}

}  // namespace

extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  double best_ratio = static_cast<double>(n_inliers) / n_samples;
  return RequiredTrials(confidence, best_ratio, sample_size);
}
""",
    "bounded_parameter.cpp": """
#include <algorithm>
#include <cmath>
#define MAX(a, b) ((a) > (b) ? (a) : (b))
#define MIN(a, b) ((a) < (b) ? (a) : (b))

static double updateTrials(double p, double ep, int model_points) {
  ep = MAX(ep, 0.);
  ep = MIN(ep, 1.);
  double denom = 1. - std::pow(1. - ep, model_points);
  if (denom < 1e-300) return 0;
  return std::log(1 - p) / std::log(denom);
}

// ransac
extern "C" double trials(int good_count, int count, int sample_size, double confidence) {
  return updateTrials(confidence, (double)(count - good_count) / count, sample_size);
}
""",
    "inverse_first.cpp": """
#include <cmath>
class Ransac {
 public:
  Ransac(int n, double s) : n_(n), log_miss_(std::log(1 - s)) {}
  double update(int inlier_count, int k) const {
    const double q = pow(static_cast<double>(inlier_count) / n_, k);
    const double log2 = log(1 - q);
    if (std::abs(log2) < 1e-300) return 1e300;
    return log_miss_ / log2;
  }
 private:
  const int n_;
  double log_miss_;
};
extern "C" double trials(int n_inliers, int n_samples, int sample_size, double confidence) {
  return Ransac(n_samples, confidence).update(n_inliers, sample_size);
}
""",
}
FLOAT = {"floats.c", "float_bounds.cpp"}
GRID = [
    (n, i, k, s)
    for n in (2, 5, 8, 20, 57, 1000)
    for i in {1, 2, 3, 7, n // 3, n // 2, n - 1, n}
    for k in (1, 2, 3, 4, 7)
    for s in (0.5, 0.99)
    if 0 < i <= n and k <= n
]


def fix(name: str, source: str, *, unsafe: bool = False) -> str:
    findings, errors = scan_source(source, SourceFile(name, "c++", named=True))
    assert not errors
    assert findings
    fixes = [one.fix for one in findings if one.fix and (unsafe or one.fix.safe)]
    return apply_edits(source, [edit for fix in fixes for edit in fix.edits])


@pytest.fixture(scope="module")
def compilers() -> None:
    if not (shutil.which("g++") and shutil.which("gcc")):
        assert not os.environ.get("CI"), "install g++: in CI nothing is skipped"
        pytest.skip("needs g++ and gcc")


def load(folder: Path, name: str, source: str) -> ctypes.CDLL:
    folder.mkdir()
    path = folder / name
    path.write_text(source)
    library = folder / "library.so"
    c = name.endswith(".c")
    command = ["gcc", "-std=c99"] if c else ["g++", "-std=c++11", "-xc++"]
    warnings = ["-Wall", "-Wextra", "-Werror", "-Wno-unused-const-variable"]
    command += [*warnings, "-shared", "-fPIC", "-O1", "-o", str(library), str(path)]
    subprocess.run([*command, *(["-lm"] if c else [])], check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.trials.restype = ctypes.c_double
    loaded.trials.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_double]
    return loaded


@pytest.mark.usefixtures("compilers")
@pytest.mark.parametrize("name", FORMS)
def test_a_fixed_function_compiles_and_is_exact(tmp_path, name):
    after = fix(name, FORMS[name])
    assert after != FORMS[name]
    old = load(tmp_path / "old", name.replace(".hpp", ".cpp"), FORMS[name]).trials
    new = load(tmp_path / "new", name.replace(".hpp", ".cpp"), after).trials
    checked = 0
    for n, i, k, s in GRID:
        if name == "product.hpp" and k != 2:
            continue
        before, now = old(i, n, k, s), new(i, n, k, s)
        p = all_inlier_probability(i, n, k)
        if not 1e-6 < p < 1:
            # Where one of the two rules has no finite answer the original's guards still hold.
            assert not math.isfinite(before) or math.isfinite(now)
            continue
        exact = math.log(1 - s) / math.log1p(-p)
        if name in FLOAT and p < 1e-3:
            continue  # 1 - p in single precision
        assert now == pytest.approx(exact, rel=1e-3 if name in FLOAT else 1e-9)
        checked += before != pytest.approx(now, rel=1e-6)
    assert checked > 20


@pytest.mark.parametrize("name", FORMS)
def test_a_fixed_file_has_nothing_left(name):
    after = fix(name, FORMS[name])
    findings, errors = scan_source(after, SourceFile(name, "c++", named=True))
    assert not findings
    assert not errors


@pytest.mark.usefixtures("compilers")
def test_two_fixed_headers_meet_in_one_file(tmp_path):
    folder = tmp_path / "both"
    folder.mkdir()
    for name in ("a.h", "b.h"):
        source = f"""#ifndef {name[0]}_H
#define {name[0]}_H
#include <cmath>
namespace ransac_{name[0]} {{
inline double trials(int n_inliers, int n, int k) {{
  return std::log(0.01) / std::log(1 - std::pow(double(n_inliers) / n, k));
}}
}}
#endif
"""
        (folder / name).write_text(fix(name, source))
    (folder / "main.cpp").write_text(
        '#include "a.h"\n#include "b.h"\n'
        "int main() { return ransac_a::trials(5, 9, 2) == ransac_b::trials(5, 9, 2) ? 0 : 1; }\n"
    )
    program = folder / "main"
    subprocess.run(["g++", "-Wall", "-Werror", "-o", program, folder / "main.cpp"], check=True)
    subprocess.run([program], check=True)


def test_cuda_gets_a_function_for_both_sides():
    source = """#include <cmath>
__device__ int ransac_trials(int n_inliers, int n, float s) {
  float w = (float) n_inliers / n;
  return ceilf(logf(1.f - s) / logf(1.f - powf(w, 3.f)));
}
"""
    after = fix("kernel.cu", source)
    assert "__host__ __device__ inline double all_inlier_probability(double n_inliers" in after
    assert "logf(1.f - all_inlier_probabilityf(n_inliers, n, 3)))" in after


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("    ", "\t"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace("/* what", "/* caf\u00e9, what"),
        lambda text: text.replace("pow(", "/* caf\u00e9 \U0001f600 */ pow /* why */ ("),
        lambda text: text.rstrip("\n"),
    ],
    ids=["crlf", "tabs", "bom", "latin-1", "comments", "no newline"],
)
def test_everything_else_stays(tmp_path, change):
    text = change(FORMS["no_header.c"])
    encoding = "latin-1" if "caf" in text and "why" not in text else "utf-8"
    path = tmp_path / "ransac.c"
    path.write_bytes(text.encode(encoding))
    result = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert result.exit_code == 0, result.output
    after = path.read_bytes().decode(encoding)
    ends = {line[len(line.rstrip("\r\n")) :] for line in after.splitlines(keepends=True)}
    assert ends - {""} == {"\r\n" if "\r\n" in text else "\n"}
    kept = [line for line in text.splitlines() if "pow" not in line or "double" in line]
    assert [line for line in after.splitlines() if line in kept and line not in "{}"] == [
        line for line in kept if line not in "{}"
    ]
    written = path.read_bytes()
    again = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert again.exit_code == 0
    assert path.read_bytes() == written


NO_FIX = {
    "only the ratio": (
        """double trials(double w, int k) {
  return log(0.01) / log(1 - pow(w, k));
}""",
        "trials is not called in this file",
    ),
    "changed in between": (
        """double trials(int n_inliers, int n, int k) {
  double w = (double)n_inliers / n;
  ++n_inliers;
  return log(0.01) / log(1 - pow(w, k)) + n_inliers;
}""",
        "may have changed since the ratio was made of it in line",
    ),
    "changed by a loop": (
        """double trials(int n_inliers, int n, int k) {
  double w = (double)n_inliers / n, t = 0;
  while (n_inliers > 0) {
    t += log(0.01) / log(1 - pow(w, k));
    n_inliers = next();
  }
  return t;
}""",
        "may have changed since the ratio was made of it in line",
    ),
    "worked out twice": (
        """double trials(Model m, int n, int k) {
  double w = (double)m.countInliers(data, n) / n;
  return log(0.01) / log(1 - pow(w, k));
}""",
        "would be worked out twice",
    ),
    "a caller with the ratio alone": (
        """static double trials(double w, int k) {
  return log(0.01) / log(1 - pow(w, k));
}
int run(int n_inliers, int n) { return trials((double)n_inliers / n, 3) + trials(0.5, 3); }""",
        "comes without them, too",
    ),
    "a name that is taken": (
        """double all_inlier_probability;
double trials(int n_inliers, int n, int k) {
  return log(0.01) / log(1 - pow((double)n_inliers / n, k));
}""",
        "the file has something else named all_inlier_probability",
    ),
    "one branch of a condition": (
        """double trials(int I, int n, int k) {
  double p =
#ifdef SINGLE
      powf((float)I / n, k);
#else
      pow((double)I / n, k);
#endif
  return log(0.01) / log(1 - p);
}""",
        "a branch of a condition",
    ),
    "a macro of statements": (
        """#define UPDATE(N, I, n) { float w = (float) I / n; N = log(0.01) / log(1 - pow(w, 3)); }
""",
        "stands in a macro",
    ),
    "a macro with arguments": (
        """#define TRIALS(s, w, k) (log(1 - (s)) / log(1 - pow((w), (k))))
""",
        "stands in a macro",
    ),
    "a percentage": (
        """double trials(double percent, int k) {
  return log(0.01) / log(1 - pow(percent / 100, k));
}""",
        "only the ratio",
    ),
    "an array of counts": (
        """Eigen::ArrayXd trials(const Eigen::ArrayXd& n_inliers, double n, int k) {
  return log(0.01) / log(1 - pow(n_inliers / n, k));
}""",
        "may be an array, and the probability takes numbers",
    ),
    "solved for the inliers": (
        """double unseen(int n, int k, int iterations, double miss) {
  return n * pow(1.0 - pow(miss, 1.0 / iterations), 1.0 / k);
}""",
        "no closed form",
    ),
}


@pytest.mark.parametrize(("source", "why"), NO_FIX.values(), ids=NO_FIX.keys())
def test_says_why_there_is_no_fix(source, why):
    source = f"#include <cmath>\n// ransac\n{source}\n"
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert finding.fix is None
    assert why in finding.no_fix


def test_an_array_of_another_function_is_no_count_of_this_one():
    source = """#include <cmath>
// ransac
void Solver::Fit() { cv::Mat N(4, 4, CV_32F); use(N); }
void Solver::SetTrials() {
  double w = (double)n_inliers / N;
  trials = log(0.01) / log(1 - pow(w, 3));
}
"""
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert finding.fix is not None


UNSAFE = {
    "a call that may change a member": """
struct Ransac {
  int n_inliers_, n_;
  double trials(int k) {
    double w = double(n_inliers_) / n_;
    refine();
    return log(0.01) / log(1 - pow(w, k));
  }
};""",
    "a function that others may call": """
double trials(double w, int k) {
  return log(0.01) / log(1 - pow(w, k));
}
double run(int n_inliers, int n) {
  return trials(double(n_inliers) / n, 3);
}""",
    "what is no count by its declaration": """
double trials(double n_inliers, double n, int k) {
  return log(0.01) / log(1 - pow(n_inliers / n, k));
}""",
}


@pytest.mark.parametrize("source", UNSAFE.values(), ids=UNSAFE.keys())
def test_is_unsafe_where_something_must_be_looked_at(source):
    source = f"#include <cmath>\n// ransac\n{source}\n"
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert finding.fix is not None
    assert not finding.fix.safe
    assert "; check that" in finding.fix.message


def test_counts_added_up_over_sets_are_not_taken_for_one_set():
    source = """#include <cmath>
#include <vector>
double ransac_trials(const std::vector<std::vector<int>>& sets,
                     const std::vector<std::vector<int>>& sample, int n_inliers) {
  size_t n = 0;
  for (size_t i = 0; i < sets.size(); i++) n += sets[i].size();
  size_t k = 0;
  for (size_t i = 0; i < sample.size(); i++) k += sample[i].size();
  double w = static_cast<double>(n_inliers) / static_cast<double>(n);
  return std::log(0.01) / std::log(1.0 - std::pow(w, static_cast<double>(k)));
}
"""
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert finding.fix is not None
    assert not finding.fix.safe
    assert "check that the sample is drawn from one set" in finding.fix.message

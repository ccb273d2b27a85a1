"""The C++ front end: the same algebra in another syntax."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.scan import cpp, scan_paths, triage
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.reading import Text
from ransac_fix.scan.scanner import read, scan_source


def sites(source: str):
    return read(cpp.parse(source), Text(source), "ransac.cpp")


def kinds(source: str) -> list[str]:
    return [found.site.probability.kind for found in sites(source)]


APPROXIMATE = {
    "a global that another function sets": """
static double good;
void prepare(double w) { good = pow(w, 4); }
int trials(double s) { return log(1 - s) / log(1 - good); }
""",
    "a member that a loop of another method makes": """
struct Ransac {
  void Prepare(double w);
  int Trials(double s) const { return std::log(1 - s) / std::log(1 - good_); }
  double good_;
};
void Ransac::Prepare(double w) {
  good_ = 1;
  for (int i = 0; i < 4; i++) good_ *= w;
}
""",
    "a member that the base class sets": """
struct Base {
  double good_;
  void Prepare(double w) { good_ = w * w * w; }
};
struct Ransac : Base {
  int Trials(double s) const { return std::log(1 - s) / std::log(1 - good_); }
};
""",
    "a member of a struct by pointer": """
struct state { double good; };
static void prepare(struct state *state, double w) { state->good = w * w * w; }
int trials(struct state *state, double w, double s) {
  prepare(state, w);
  return log(1 - s) / log(1 - state->good);
}
""",
    "macros of one's own for bounds": """
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define SMALLER(a, b) (((a) < (b)) ? (a) : (b))
int trials(double w, double s) {
  return SMALLER(1000, LARGER(1, log(LARGER(1e-9, 1 - s)) / log(LARGER(1e-9, 1 - w * w * w))));
}
""",
    "a fraction of all samples": """
int Trials(int I, int n, int k) {
  return std::log(0.01) / std::log((std::pow(n, k) - std::pow(I, k)) / std::pow(n, k));
}
""",
    "a difference of logarithms": """
int Trials(int I, int n, int k) {
  return std::log(0.01) / (std::log(std::pow(n, k) - std::pow(I, k)) - k * std::log(n));
}
""",
    "Qt's functions": """
int Trials(double w, int k, double s) { return qCeil(qLn(1 - s) / qLn(1 - qPow(w, k))); }
""",
    "Unreal's functions": """
int32 Trials(double W, int32 K, double S) {
  return FMath::CeilToInt(FMath::LogX(1 - FMath::Pow(W, K), 1 - S));
}
""",
    "GSL's functions": """
int trials(double w, double s) { return ceil(gsl_log1p(-s) / gsl_log1p(-gsl_pow_3(w))); }
""",
    "an integer power of GSL": """
int trials(double w, int k, double s) { return log(1 - s) / log(1 - gsl_pow_int(w, k)); }
""",
    "OpenCL's functions": """
int trials(float w, float k, float s) {
  return ceil(native_log(1 - s) / native_log(1 - native_powr(w, k)));
}
""",
    "functions in capitals": """
int trials(float w, int k, float s) { return CEIL(LOG(1 - s) / LOG(1 - POW(w, k))); }
""",
    "a difference that is not negative": """
int Trials(double w, int k, double s) {
  return std::log(std::fdim(1.0, s)) / std::log(std::fdim(1.0, std::pow(w, k)));
}
""",
    "a declaration in a condition": """
int Trials(double w, int i) {
  if (auto trials = std::log(0.01) / std::log(1 - std::pow(w, 4)); trials > i) return 1;
  return 0;
}
""",
    "members of a struct by their order": """
struct Quotient { double top; double bottom; double Value() const; };
int Trials(double w, int k, double s) {
  const Quotient q{std::log(1 - s), std::log(1 - std::pow(w, k))};
  return q.top / q.bottom;
}
""",
    "members of a struct by their names": """
struct quotient { double top, bottom; };
int trials(double w, int k, double s) {
  struct quotient q = {.bottom = log(1 - pow(w, k)), .top = log(1 - s)};
  return q.top / q.bottom;
}
""",
    "two parts of one value": """
int Trials(double w, int k, double s) {
  const auto [top, bottom] = std::make_pair(std::log(1 - s), std::log(1 - std::pow(w, k)));
  return top / bottom;
}
""",
    "a sum of logarithms": """
int Run(double s) {
  double failed = 0, best = 0;
  int i = 0;
  for (; i < 1000; i++) {
    const double w = Evaluate(i);
    if (w > best) best = w;
    failed += std::log(1 - std::pow(best, 4));
    if (failed < std::log(1 - s)) break;
  }
  return i;
}
""",
    "a logarithm by its name": """
int Trials(double w) { return m_logEta / std::log(1 - std::pow(w, 3)); }
""",
    "a numerator by its name": """
class Ransac {
  double numerator_;
  int Trials(double w) const { return numerator_ / std::log(1 - std::pow(w, 3)); }
};
""",
    "a macro that holds the formula": """
#define TRIALS ((int) (log(1 - P) / \\
  log(1 - pow(W, 4)))) /* of an assumed ratio */
""",
    "a macro with arguments": """
#define ALL_INLIERS(w, k) pow((w), (k)) // the chance of a good sample
int Trials(int inliers, int n, double s) {
  return (int) ceil(log(1.0 - s) / log(1.0 - ALL_INLIERS((double) inliers / n, 7)));
}
""",
    "a macro of statements": """
#define UPDATE(trials, inliers, n) do { \\
  double w = (double) (inliers) / (n); \\
  trials = log(0.01) / log(1 - w * w * w); \\
} while (0)
""",
    "a power by reference": """
static void GoodSample(double w, int k, double& p) {
  if (k == 0) {
    p = 1;
    return;
  }
  p = std::pow(w, k);
}
int Trials(double w, int k, double s) {
  double p;
  GoodSample(w, k, p);
  return std::log(1 - s) / std::log(1 - p);
}
""",
    "a power by pointer": """
void good_sample(double w, int k, double *p) { *p = pow(w, k); }
int trials(double w, int k, double s) {
  double p;
  good_sample(w, k, &p);
  return log(1 - s) / log(1 - p);
}
""",
    "a literal with its sign": """
int Trials(double w, double s) { return std::log(1 - s) * pow(std::log(-1 * w * w * w + 1), -1); }
""",
    "overloads told apart by their arguments": """
double GoodSample(int inliers, int n, int k) { return GoodSample(double(inliers) / n, k); }
double GoodSample(double w, int k) { return std::pow(w, k); }
int Trials(int inliers, int n, double s) {
  return std::log(1 - s) / std::log(1 - GoodSample(inliers, n, 4));
}
""",
    "a method of its own class": """
struct Other { double Good() const { return 1; } };
struct Ransac {
  double Good() const { return w * w * w; }
  int Trials(double s) const { return std::log(1 - s) / std::log(1 - Good()); }
  double w;
};
""",
    "behind a macro that hides an if": """
bool Robust(const Options& o, Result& results) {
  START_OF_CHECKED_CODE

  if (o.n < o.k)
  {
    results.clear();
    return false;
  }

  double q = 1 - pow(results.inlier_ratio, static_cast<double>(2.0 /* sample size */));
  results.trials = static_cast<unsigned int>(round(log(1 - o.confidence) / log(q)));
}
""",
    "a power function of one's own": """
int Trials(double w, int k, double s) {
  double p = math::fastpow(w, k);
  return static_cast<int>(std::log(1.0 - s) / std::log(1.0 - p));
}
""",
    "a default of a member": """
struct Ransac {
  double confidence, outliers;
  int n = 2;
  unsigned trials = log(1 - confidence) / log(1 - pow(1 - outliers, n));
};
""",
    "a macro for the logarithm of the failure": """
#define LOG_ETA_0 log(0.05)
unsigned Bound(int inliers) {
  double p = pow((double)inliers / n, k), log_eta = 0;
  for (unsigned i = 0; i < tests; i++)
    log_eta += log(1 - p * (1 - pow(A[i], -h))) * counts[i];
  double top = LOG_ETA_0 - log_eta;
  double bottom = log(1 - p * (1 - 1 / A[tests]));
  return top / bottom;
}
""",
    "plain": """
int Trials(double w, int k, double s) {
  return static_cast<int>(std::ceil(std::log(1.0 - s) / std::log(1.0 - std::pow(w, k))));
}
""",
    "clamps with parenthesised names": """
double Update(int best, int total, const std::vector<int>& selection, double log_probability) {
  const double w = static_cast<double>(best) / static_cast<double>(total);
  double p = 1.0 - pow(w, static_cast<double>(selection.size()));
  p = (std::max)(std::numeric_limits<double>::epsilon(), p);
  p = (std::min)(1.0 - std::numeric_limits<double>::epsilon(), p);
  return log_probability / std::log(p);
}
""",
    "members set elsewhere": """
class Ransac {
 public:
  Ransac(double confidence) : log_probability_(std::log(1 - confidence)) {}
  void Update() {
    const double q = std::pow(inliers_ / n_, k_);
    trials_ = log_probability_ / std::log(1.0 - q);
  }
 private:
  double log_probability_, inliers_, n_, trials_;
  int k_ = 4;
};
""",
    "defined outside of the class": """
template <typename M>
void Ransac<M>::Update(size_t n_inliers) {
  num_ = std::max(1.0 - confidence_, DBL_MIN);
  double den = 1.0 - std::pow(double(n_inliers) / n_, sample_size_);
  den = log(den);
  iterations_ = log(num_) / den;
}
""",
    "a lambda in a loop": """
void Segment(const Cloud& cloud, double ransac_probability) {
  tbb::parallel_for(0, n, [&](const Range& range) {
    for (int i = range.begin(); i < range.end(); ++i) {
      if (better) stop = std::min(log(1 - p) / log(1 - pow(fitness, 3)), (double)limit);
    }
  });
}
""",
    "a product of powers": """
double Hybrid(const std::vector<double>& ratios, const std::vector<int>& sizes, double s) {
  double p = 1.0;
  for (size_t i = 0; i < sizes.size(); ++i) {
    p *= std::pow(ratios[i], static_cast<double>(sizes[i]));
  }
  return std::log(s) / std::log(1.0 - p);
}
""",
    "C, with a conditional": """
int trials(int inliers, int n, int k, double s) {
  double e = (double)(n - inliers) / n;
  double d = 1. - pow(1. - e, k);
  return d < 1e-9 ? 0 : (int)(log(1. - s) / log(d) + 0.5);
}
""",
    "CUDA": """
__global__ void kernel(float *out, int k) {
  out[threadIdx.x] = logf(0.01f) / logf(1.0f - powf(inlier_ratio, k));
}
""",
    "behind the preprocessor": """
namespace a { namespace b {
#ifdef USE_RANSAC
inline double trials(double w, double s) { return log(1 - s) / log(1 - w * w * w * w); }
#else
int other();
#endif
}}
""",
    "a test in a loop": """
void ransac() {
  int t = 0;
  do {
    ++t;
  } while (1.0 - std::pow(1.0 - std::pow(w, 3), t) < confidence);
}
""",
    "the number of inliers that would have been seen": """
size_t Unseen(double miss, size_t k, size_t trials, size_t points) {
  const double one_over_trials = 1.0 / trials;
  const double one_over_k = 1.0 / k;
  const double inlier_ratio = pow(1.0 - pow(miss, one_over_trials), one_over_k);
  return std::round(points * inlier_ratio);
}
""",
    "a power by a template": """
double ransac_trials(double w, double s) {
  return log(1 - s) / log(1 - boost::math::pow<4>(w));
}
""",
    "casts of libraries": """
int ransac_trials(double w, int k, double s) {
  return log(1 - s) / log(1 - boost::numeric_cast<float>(cv::saturate_cast<double>(pow(w, k))));
}
""",
    "powers of two": """
double ransac_trials(double w, int k, double s) {
  return std::log2(1 - s) / std::log2(1 - std::exp2(k * std::log2(w)));
}
""",
    "intrinsics": """
__device__ float ransac_trials(float w, float k, float s) {
  return __fdividef(__logf(1.f - s), __logf(1.f - __powf(w, k)));
}
""",
    "the functions of long double": """
int ransac_trials(long double w) {
  return (int)ceill(logl(0.01L) / log1pl(-expl(4.0L * log10l(w))));
}
""",
    "a logarithm worked out beforehand, with its sign": """
int ransac_trials(double w) { return (int)std::ceil(-4.605 / std::log(1.0 - std::pow(w, 5))); }
""",
    "functions under the prefix of a library": """
double ransac_trials(double w, int k, double s) {
  return vcl_log(1 - s) / vcl_log(1 - vcl_pow(w, k));
}
""",
    "a macro for a square": """
#define SQR(x) ((x) * (x))
double ransac_trials(double w, double s) { return log(1 - s) / log(1 - SQR(SQR(w))); }
""",
    "typed constants": """
template <typename T> T RansacTrials(T s, T w, int k) {
  return std::ceil(std::log(T(1) - s) / std::log(T(1) - std::pow(w, T(k))));
}
""",
    "typed constants, cast": """
template <class Number> Number ransac_trials(Number s, Number w, int k) {
  const Number one = static_cast<Number>(1);
  return std::log(one - s) / std::log(static_cast<Number>(1) - std::pow(w, k));
}
""",
    "typed constants of a type that is named here": """
template <class Model> double ransac_trials(double s, double w, int k) {
  using Value = typename Model::Number;
  return log(Value(1) - s) / log(Value{1} - pow(w, k));
}
""",
    "typed constants of a type that is named elsewhere": """
template <class Model>
double ransac_trials(typename Model::Scalar s, typename Model::Scalar w, int k) {
  return log(typename Model::Scalar(1) - s) / log(typename Model::Scalar(1) - pow(w, k));
}
""",
    "a count that an expression changes in passing": """
double ransac_trials(const Points& points, double s) {
  int kept[100], n = 0;
  for (int i = 0; i < points.size(); ++i) {
    if (points.bad(i)) continue;
    kept[n++] = i;
  }
  double w = (double)points.inliers / n;
  return log(1 - s) / log(1 - w * w * w * w);
}
""",
    "a test whose other power is written out": """
void ransac(double confidence) {
  int t = 0;
  while (true) {
    double w = vote();
    if (1 - std::pow(1 - w * w, ++t) > confidence) break;
  }
}
""",
    "a probability that each run makes smaller": """
void ransac(double confidence) {
  double failure = 1.0;
  while (failure > 1 - confidence) {
    double w = vote();
    failure *= 1 - w * w * w;
  }
}
""",
    "a helper": """
static double all_inliers(double w, int k) { return std::pow(w, k); }
double ransac_trials(double w, double s) { return log(1 - s) / log(1 - all_inliers(w, 3)); }
""",
}
EXACT = {
    "a product in a global": """
static double good;
void prepare(int inliers, int n) {
  good = 1;
  for (int i = 0; i < 4; i++) good *= (double) (inliers - i) / (n - i);
}
int trials(double s) { return log(1 - s) / log(1 - good); }
""",
    "a product in a macro": """
#define FALLING(n) ((n) * ((n) - 1) * ((n) - 2))
int Trials(double inliers, double n, double s) {
  return log(1 - s) / log(1 - FALLING(inliers) / FALLING(n));
}
""",
    "a product by reference": """
void GoodSample(int inliers, int n, int k, double& p) {
  p = 1;
  for (int i = 0; i < k; i++) p *= double(inliers - i) / (n - i);
}
int Trials(int inliers, int n, int k, double s) {
  double p;
  GoodSample(inliers, n, k, p);
  return std::log(1 - s) / std::log(1 - p);
}
""",
    "a loop": """
size_t Trials(size_t inliers, size_t n, size_t k, double s) {
  double p = 1.0;
  for (size_t i = 0; i < k; ++i) {
    p *= (inliers - i) / static_cast<double>(n - i);
  }
  return std::ceil(std::log(1 - s) / std::log(1 - p));
}
""",
    "two products, downwards": """
double Trials(int I, int n, int k, double s) {
  double a = 1, b = 1;
  for (int i = k - 1; i >= 0; i--) { a *= I - i; b *= n - i; }
  return log(1 - s) / log(1 - a / b);
}
""",
    "while": """
double ransac_trials(int I, int n, int k, double s) {
  double p = 1; int i = 0;
  while (i < k) { p = p * (I - i) / (n - i); i += 1; }
  return log(1 - s) / log(1 - p);
}
""",
    "binomial coefficients": """
unsigned ransac_trials(unsigned I, unsigned n, unsigned k, double s) {
  unsigned good = boost::math::binomial_coefficient<double>(I, k);
  unsigned all = boost::math::binomial_coefficient<double>(n, k);
  return ceil(log(1 - s) / log(1 - double(good) / double(all)));
}
""",
    "written out, of a count that is one of several": """
double ransac(int n, double s) {
  int best = 0; double N = 1000;
  for (int t = 0; t < N; ++t) {
    int count = evaluate(t);
    if (count > best) best = count;
    double q = (double)best / n * ((double)(best - 1) / (n - 1)) * ((double)(best - 2) / (n - 2));
    N = log(1 - s) / log(1 - q);
  }
  return N;
}
""",
    "lgamma": """
double ransac(int I, int n, int k, double s) {
  return log(1-s) / log(1 - exp(lgamma(I+1) - lgamma(I-k+1) - lgamma(n+1) + lgamma(n-k+1)));
}
""",
}
OTHER = {
    "a sum of logarithms of no power": """
bool Ransac(double s) {
  double sum = 0;
  for (int i = 0; i < 10; i++) sum += log(1 - residual[i]);
  return sum < log(1 - s);
}
""",
    "octree cells": """
double stop_probability(double m, double n, double d, int k, double candidates) {
  return std::min(std::pow(1. - m / (n * d * (1 << (k - 1))), candidates), 1.);
}
""",
    "a sample of one": "double ransac(double w) { return log(0.01) / log(1 - pow(w, 1.0f)); }",
    "an entry of a vector": """
double ransac(const Vector& T, double s, double w, int k) {
  return log(T(1) - s) / log(T(1) - pow(w, k));
}
""",
    "a comment": "// ransac: log(1 - s) / log(1 - pow(w, k))\nint n;",
    "a string": 'const char* ransac = "log(1 - s) / log(1 - pow(w, k))";',
}


@pytest.mark.parametrize("source", APPROXIMATE.values(), ids=APPROXIMATE.keys())
def test_reads_as_approximate(source):
    assert kinds(source) == ["approximate"]


@pytest.mark.parametrize("source", APPROXIMATE.values(), ids=APPROXIMATE.keys())
def test_the_gate_lets_it_through(source):
    code, _ = triage.split(source, "c++")
    assert triage.could_hold_a_rule(code)


@pytest.mark.parametrize("source", EXACT.values(), ids=EXACT.keys())
def test_reads_as_exact(source):
    assert kinds(source) == ["exact"]


@pytest.mark.parametrize("source", OTHER.values(), ids=OTHER.keys())
def test_reads_as_something_else(source):
    assert kinds(source) == []


def test_names_the_roles_and_the_place():
    source = APPROXIMATE["clamps with parenthesised names"]
    (finding,), errors = scan_source(source, SourceFile("ransac.hpp", "c++", named=True))
    assert not errors
    assert finding.code == "RFX001"
    place = finding.location
    line = source.splitlines()[place.start_line - 1]
    assert line[place.start_column - 1 : place.end_column - 1] == "log_probability / std::log(p)"
    assert finding.roles["n_inliers"] == "best"
    assert finding.roles["n_samples"] == "total"
    assert finding.roles["sample_size"] == "selection.size()"


@pytest.mark.parametrize("word", ["nInliners", "Vanishing Point", "fundamental_matrix", "InLier"])
def test_words_are_known_in_any_spelling(word):
    source = f"int Trials(double w, double s) {{ return log(1 - s) / log(1 - w * w); }} // {word}"
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=False))
    assert finding.code in ("RFX001", "RFX002")


def test_words_are_not_found_across_others():
    source = (
        "int Trials(double w, double s) { return log(1 - s) / log(1 - w * w); } // itemsAccount"
    )
    found, _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert not found


def test_columns_count_characters():
    source = 'auto \u00e9 = "\u00e9\U0001f600"; double ransac = log(0.1) / log(1 - pow(w, 3));\n'
    (found,) = sites(source)
    assert source[found.site.span.column :].startswith("log(0.1)")


def test_a_comment_sets_a_finding_aside():
    source = "double ransac = log(0.1) / log(1 - pow(w, 3));"
    file = SourceFile("a.cpp", "c++", named=True)
    (finding,), _ = scan_source(f"{source}  // ransac-fix: ignore[RFX002] -- paper\n", file)
    assert finding.suppression == "paper"
    (unused,), _ = scan_source("int n;  // ransac-fix: ignore\n", file)
    assert unused.code == "RFX901"


@pytest.mark.parametrize("suffix", ["c", "cc", "cpp", "h", "hpp", "cu", "cuh", "ipp"])
def test_files_are_known_by_their_suffix(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(b"// caf\xe9\ndouble ransac = log(0.1) / log(1 - pow(w, 3));\n")
    (finding,) = scan_paths([tmp_path]).findings
    assert finding.location.start_line == 2


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_no_source_crashes_it(data):
    source = data.draw(st.sampled_from([*APPROXIMATE.values(), *EXACT.values()]))
    start = data.draw(st.integers(0, len(source)))
    end = data.draw(st.integers(start, min(len(source), start + 40)))
    noise = data.draw(
        st.sampled_from(["", "{", "}", "(", ")", ";", "::", "<", "\\\n", "#if", "\x00"])
    )
    file = SourceFile("ransac.cpp", "c++", named=True)
    scan_source(source[:start] + noise + source[end:], file, gate=False)


DRAWS = {
    "unchecked": ("sample.push_back(rand() % n);", "RFX003"),
    "unchecked, of a large range": (
        "sample.push_back((rand() * RAND_MAX + rand()) % n);",
        "RFX003",
    ),
    "unchecked, by a call": ("sample.push_back(RandomInt(0, n - 1));", "RFX003"),
    "unchecked, by a distribution": (
        "std::uniform_int_distribution<int> dice(0, n - 1); sample.push_back(dice(engine));",
        "RFX003",
    ),
    "unchecked, by OpenCV": ("sample.push_back(rng.uniform(0, n));", "RFX003"),
    "a shuffle's step": (
        "int i = j + rand() % (n - j), t = all[i]; all[i] = all[j]; all[j] = t;",
        "RFX001",
    ),
    "marked": (
        "int i; do { i = rand() % n; } while (used[i]); used[i] = true; sample.push_back(i);",
        "RFX001",
    ),
    "marked in the data": (
        "Point* p; do { p = all + rand() % n; } while (p->used); p->used = 1;",
        "RFX001",
    ),
    "found before": (
        """int i = rand() % n;
           if (std::find(sample.begin(), sample.end(), i) == sample.end()) sample.push_back(i);""",
        "RFX001",
    ),
    "taken out": (
        """int i = RandomInt(0, left.size() - 1);
           sample.push_back(left[i]); left[i] = left.back(); left.pop_back();""",
        "RFX001",
    ),
    "drawn again": (
        "int i = rand() % n; while (i == last) { i = rand() % n; } sample.push_back(i);",
        "RFX001",
    ),
}


@pytest.mark.parametrize(("draw", "code"), DRAWS.values(), ids=DRAWS)
def test_reads_a_sampler_that_draws_one_index_at_a_time(draw, code):
    source = f"""
#include <cmath>
int ransac(int n, int k, double s) {{
  double N = 1000;
  for (int t = 0; t < N; ++t) {{
    std::vector<int> sample;
    for (int j = 0; j < k; ++j) {{ {draw} }}
    int n_inliers = evaluate(sample);
    N = log(1 - s) / log(1 - pow(double(n_inliers) / n, k));
  }}
  return N;
}}
"""
    (finding,), _ = scan_source(source, SourceFile("a.cpp", "c++", named=True))
    assert finding.code == code
    # Distinct samples have no form of their own here, and the power alone is not replaced.
    assert (finding.fix is None) == (code == "RFX003")


def test_a_negative_index_is_no_entry_and_no_crash():
    source = "double ransac(double* a) { return log(a[-1]) / log(1 - pow(a[-2], 3)); }"
    assert kinds(source) == ["approximate"]

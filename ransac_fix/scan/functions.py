"""The mathematical functions of every library, under one name each.

Libraries differ in spelling (``np.power``, ``std::pow``, ``x.pow(k)``, ``torch.pow``) but not in
meaning, so what counts is the last part of a name. A function of the scanned file with the same
name is followed instead, if its body can be.
"""

import re


def _of_c(*names: str) -> tuple[str, ...]:
    """Give functions of C's math.h with their kin for float and long double."""
    return tuple(name + kin for name in names for kin in ("", "f", "l"))


# Functions of one argument, written f(x) or x.f(). "same" leaves the value alone for the
# recogniser's purposes: casts, rounding, containers, moves between devices.
UNARY: dict[str, str] = {
    **dict.fromkeys((*_of_c("log", "log10", "log2"), "Log", "Log10", "LOG", "Log_e"), "log"),
    **dict.fromkeys(("ln", "LN", "Loge", "alog", "qLn"), "log"),
    **dict.fromkeys(_of_c("log1p"), "log1p"),
    # With the bases of logarithms left out, exp2(k*log2(w)) is exp(k*log(w)).
    **dict.fromkeys((*_of_c("exp", "exp2", "exp10"), "Exp", "__expf", "__exp10f"), "exp"),
    **dict.fromkeys(_of_c("expm1"), "expm1"),
    **dict.fromkeys(("square", "sqr"), "square"),
    **dict.fromkeys(_of_c("sqrt"), "sqrt"),
    "reciprocal": "reciprocal",
    **dict.fromkeys(("negative", "neg"), "neg"),
    **dict.fromkeys(("factorial", "fact"), "factorial"),
    **dict.fromkeys(("gamma", "tgamma"), "gamma"),
    **dict.fromkeys(("lgamma", "gammaln", "loggamma"), "lgamma"),
    **dict.fromkeys(
        [
            *_of_c("ceil", "fabs", "floor", "llrint", "llround", "lrint", "lround", "nearbyint"),
            *_of_c("rint", "round", "trunc"),
            "Abs",
            "Decimal",
            "Fraction",
            "Integer",
            "Tensor",
            "abs",
            "absolute",
            "array",
            "as_tensor",
            "asarray",
            "asscalar",
            "astype",
            "atleast_1d",
            "bool",
            "clone",
            "contiguous",
            "copy",
            "cpu",
            "cuda",
            "cvCeil",
            "cvFloor",
            "cvRound",
            "detach",
            "double",
            "fix",
            "float",
            "float16",
            "float32",
            "float64",
            "half",
            "int",
            "int16",
            "int32",
            "int64",
            "int8",
            "int_",
            "item",
            "lfloor",
            "list",
            "long",
            "max",
            "min",
            "mean",
            "nan_to_num",
            "narrow_cast",
            "numeric_cast",
            "numpy",
            "ravel",
            "real",
            "round_",
            "saturate_cast",
            "size_t",
            "squeeze",
            "static_cast",
            "t",
            "tensor",
            "to",
            "tolist",
            "tuple",
            "type",
            "uint16",
            "uint32",
            "uint64",
            "unsigned",
            "view",
            "int64_t",
            "int32_t",
            "uint32_t",
            "uint64_t",
            "float_t",
            "unsqueeze",
            "flatten",
        ],
        "same",
    ),
}

# Functions of two arguments, written f(x, y) or x.f(y).
BINARY: dict[str, str] = {
    **dict.fromkeys(
        ("pow", "power", "powf", "powi", "powl", "float_power", "Pow", "ipow", "npow"), "pow"
    ),
    **dict.fromkeys(
        (
            "divide",
            "true_divide",
            "div",
            "fdiv",
            "truediv",
            "fdividef",
            "__fdividef",
            "divide_no_nan",
        ),
        "div",
    ),
    **dict.fromkeys(("floor_divide", "floordiv"), "floordiv"),
    **dict.fromkeys(("multiply", "mul"), "mul"),
    **dict.fromkeys(("subtract", "sub", "fdim", "fdimf"), "sub"),
    "rsub": "rsub",
    "add": "add",
    **dict.fromkeys(
        [
            "Binomial",
            "Choose",
            "binom",
            "binomial",
            "binomial_coefficient",
            "binomialCoefficient",
            "choose",
            "comb",
            "nCr",
            "n_choose_k",
            "nchoosek",
            "ncr",
        ],
        "comb",
    ),
    **dict.fromkeys(("perm", "nPr", "npr", "falling_factorial", "poch"), "comb"),
}

# Functions that libraries write for themselves: fastpow, int_pow, powInt, pow_n, vcl_log, safe_log,
# gsl_pow_int, qPow, native_powr.
_OWN = "_*(?:fast|quick|my|int|integer|safe|const|static|gpu|cuda|native|half|std|vcl|gsl|q|cv)"
# No more spellings than ``triage`` looks for.
_OWN_LOG = re.compile(rf"(?:{_OWN}_|_+)?(?:[lL]og(?:2|10|1p|[fl])?|ln)")
_OWN_POWER = re.compile(
    rf"(?:{_OWN})?_*pow(?:er)?"
    r"(?:_?(?:fast|int|integer|i|u|n|r|f|d|k|int32|uint|scalar))?_?",
    re.IGNORECASE,
)
_OWN_FIXED = {
    **dict.fromkeys(("sq", "sqr", "square", "squared"), 2.0),
    **dict.fromkeys(("cube", "cubed"), 3.0),
    "gsl_pow_2": 2.0,
}
_OWN_DIGIT = re.compile(r"(?:[a-z]+_)?pow(?:er)?_?([3-9])")  # pow2(x) may be 2**x


def is_power(name: str) -> bool:
    """Whether a function of two arguments is a power by its name."""
    return BINARY.get(name) == "pow" or _OWN_POWER.fullmatch(name) is not None


def not_in_place(name: str) -> str:
    """Name the function that ``x.log_()`` works out in place of x."""
    plain = name.removesuffix("_")
    return plain if plain in UNARY or plain in BINARY else name


def own_logarithm(name: str) -> str | None:
    """Say which logarithm a function is by its name: ``log``, ``log1p`` or none."""
    if _OWN_LOG.fullmatch(name) is None:
        return None
    return "log1p" if "1p" in name else "log"


def fixed_power(name: str) -> float | None:
    """Give the power that a function of one argument takes by its name."""
    digit = _OWN_DIGIT.fullmatch(name.lower())
    return float(digit[1]) if digit is not None else _OWN_FIXED.get(name.lower())


# Bounds on a value: clip(x, low, high), x.clamp(min=low), max(x, low).
CLAMPS = frozenset(
    [
        "amax",
        "amin",
        "clamp",
        "clamp_",
        "clamp_max",
        "clamp_min",
        "clip",
        "clip_by_value",
        *_of_c("fmax", "fmin"),
        "max",
        "maximum",
        "min",
        "minimum",
        "MAX",
        "MIN",
        "Max",
        "Min",
    ]
)

# What no value has as a method with that many arguments: m.log(x), m.pow(x, k).
MATHEMATICS = frozenset(("log", "log1p", "exp", "expm1", "pow", "comb", "lgamma", "factorial"))

# Comparisons written as functions: np.less(x, y), x.lt(y), operator.lt(x, y).
COMPARISONS: dict[str, str] = {
    **dict.fromkeys(("less", "lt", "isless", "searchsorted"), "<"),
    "Eq": "<=",  # to be solved for the trials
    **dict.fromkeys(("less_equal", "le", "islessequal"), "<="),
    **dict.fromkeys(("greater", "gt", "isgreater"), ">"),
    **dict.fromkeys(("greater_equal", "ge", "isgreaterequal"), ">="),
}
# Of the geometric and the binomial distribution of scipy.stats.
DISTRIBUTED = frozenset(("ppf", "isf", "cdf", "sf", "pmf"))
# What makes an object of names and values.
RECORDS = frozenset(
    (
        "dict",
        "SimpleNamespace",
        "Namespace",
        "OrderedDict",
        "EasyDict",
        "edict",
        "AttrDict",
        "Munch",
    )
)
PRODUCTS = frozenset(("prod", "product", "cumprod"))
SUMS = frozenset(("sum", "fsum", "nansum"))
RANGES = frozenset(("arange", "range", "xrange", "trange", "iota"))
SELECTS = frozenset(("where", "select", "ifelse"))
ONES = frozenset(("ones", "ones_like", "new_ones"))
ZEROS = frozenset(("zeros", "zeros_like", "new_zeros"))
FULLS = frozenset(("full", "full_like"))
COUNTS = frozenset(
    [
        "len",
        "sum",
        "count_nonzero",
        "countNonZero",
        "size",
        "count",
        "nnz",
        "numel",
        "shape",
        "rows",
        "cols",
        "total",
        "length",
        "n_elements",
        "nonzero",
    ]
)

# Modules under the names people give them, for code that does not show its import (notebooks).
MODULES = frozenset(
    [
        "np",
        "numpy",
        "math",
        "cmath",
        "torch",
        "tf",
        "jnp",
        "jax",
        "cp",
        "cupy",
        "scipy",
        "sp",
        "special",
        "stats",
        "mpmath",
        "sympy",
        "np.random",
        "std",
        "cv",
        "cv2",
        "Math",
        "tensorflow",
        "numpy.random",
        "K",
        "keras",
        "onp",
        "mx",
        "nd",
        "xp",
        "random",
        "tf.math",
        "scipy.special",
        "scipy.stats",
        "functools",
        "operator",
        "itertools",
    ]
)

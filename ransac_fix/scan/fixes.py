"""Changes to source that make a rule exact, decided once for all languages.

A fix replaces the power by a call of a small function that it adds to the file, and touches
nothing else: guards, rounding and limits stay as they are. It needs both counts where the power
stands, with the values that the ratio was made of; where a function takes the ratio, it is made to
take the counts, and its calls to give them. Text outside of the edits is never written anew, so
formatting, comments, line ends and encoding stay.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from ransac_fix.scan import algebra
from ransac_fix.scan.findings import Edit, Fix
from ransac_fix.scan.form import Choice, Expr, Fn, Name, Num, Op, Over, Span
from ransac_fix.scan.origins import origin
from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.recogniser import probability_of
from ransac_fix.scan.sizes import size_drawn
from ransac_fix.scan.source import Argument, Signature, Source, is_inside

_ONLY_RATIO = "only the ratio of inliers is known here, not the two counts it is made of"
_MESSAGE = "use the probability for distinct samples"


@dataclass(frozen=True, slots=True)
class Counts:
    """Both counts of a ratio, and for each the place where the ratio took its value."""

    n_inliers: Expr
    n_samples: Expr
    inliers_at: Span
    samples_at: Span


def fix_probability(read: ReadSite, source: Source, path: str) -> Fix | str:
    """Replace the power of a site, or say why that cannot be done."""
    site = read.site
    if site.form == "inverse":
        return "the rule solved for the number of inliers has no closed form without replacement"
    probability = site.probability
    alone = probability.constant == 1.0 and not probability.other_factors
    target = algebra.plain(site.assumed) if alone else probability.power
    if isinstance(target, Choice):
        target = probability.power  # and not what it is chosen from, a guard
    if target is None or target.span is None:
        return "the power is not written in one place"
    size = read.roles.get("sample_size")
    if not size:
        return "the sample size cannot be spelled here"
    drawn = size_drawn(read)
    if drawn is not None:
        return f"{size} is not the size of the sample, {drawn}: see RFX004"
    for expr in (probability.ratio, probability.exponent):
        if expr is not None and source.is_array(expr, target.span):
            return _not_a_number(expr, source)
    support = source.support(target.span, path)
    if isinstance(support, str):
        return support
    counts = counts_at(read)
    if counts is None:
        threaded = _through_calls(read, source, path, target.span, size)
        if isinstance(threaded, str) and not read.adaptive:
            budget = _with_expected_counts(read, source, target.span, size)
            if isinstance(budget, str):
                called = any(one.call is not None for one in site.seen)
                return threaded if called else budget
            threaded = budget
        if isinstance(threaded, str):
            return threaded
        message, safe, edits, call = threaded
    else:
        values = _values(counts, source, target.span)
        if isinstance(values, str):
            return values
        inliers, samples, doubt = values
        if not doubt and _is_sum(counts.n_samples) and _is_sum(probability.exponent):
            doubt = (
                "; check that the sample is drawn from one set, not so many from each of several"
            )
        message, safe = f"{_MESSAGE}{doubt}", not doubt
        call = source.probability(inliers, samples, size, target.span)
        edits = source.unused_without(site.assumed, target.span, call, path)
    edit = source.edit(target.span, call, path)
    return Fix(message, safe, (*support, *edits, edit))


def fix_sampler(read: ReadSite, source: Source, path: str) -> Fix | str:
    """Make the sampler of a site draw distinct samples, or say why that cannot be done."""
    if read.draw is None:
        return "the sampler was not found"
    edits = source.distinct_draw(read.draw, path)
    if isinstance(edits, str):
        return edits
    return Fix("draw distinct samples", safe=False, edits=edits)


def _not_a_number(expr: Expr, source: Source) -> str:
    return f"{source.spell(expr)} may be an array, and the probability takes numbers"


# ---- counts ---------------------------------------------------------------------------------


def counts_at(read: ReadSite) -> Counts | None:
    """Find the two counts of a site."""
    probability = read.site.probability
    if probability.ratio is not None:
        own = counts_of(probability.ratio)
        if own is not None:
            return own
    match algebra.plain(read.site.assumed):
        case Op(op="mul", args=(_, ratio)):  # w*w*w
            return counts_of(ratio)
        case Op(op="div", args=(top, bottom)) as assumed:  # I**k / n**k
            match algebra.plain(top), algebra.plain(bottom):
                case Op(op="pow", args=(one, _)), Op(op="pow", args=(other, _)):
                    return _made(one, other, assumed, assumed)
    return None


def counts_of(ratio: Expr) -> Counts | None:
    """Read I and n out of I/n, I*(1/n), 1 - outliers/n or 1 - (n - I)/n, if there is one way to.

    Unlike the recogniser this keeps names: what a name stood for earlier may have changed since.
    """
    found = _only(algebra.readings(ratio))
    match found[0] if found else None:
        case Op(op="div", args=(top, bottom)) as division:
            return _made(top, bottom, division, division)
        case Op(op="mul", args=(left, right)) as product:
            for count, other in ((left, right), (right, left)):
                match algebra.plain(other):
                    case Op(op="div", args=(one, total)) as reciprocal:
                        if algebra.number(one) == 1.0:
                            return _made(count, total, product, reciprocal)
        case Op(op="add" | "sub") as difference:
            constant = 0.0
            others: list[tuple[int, Expr]] = []
            for sign, term in algebra.terms(difference):
                value = algebra.number(term)
                if value is None:
                    others += [(sign, one) for one in _only(algebra.readings(term))]
                else:
                    constant += sign * value
            match others:
                case [(-1, Op(op="div", args=(top, bottom)) as division)] if constant == 1.0:
                    return _made(_rest_of(bottom, top), bottom, division, division)
                case [(1, Op(op="div", args=(top, bottom)) as division)] if constant == 0.0:
                    return _made(top, bottom, division, division)
    return None


def _rest_of(total: Expr, part: Expr) -> Expr:
    """Give total - part, or I where part is written total - I."""
    inner = part
    while isinstance(inner, Fn) and inner.name == "same":
        inner = inner.args[0]
    match inner:
        case Op(op="sub", args=(whole, rest)) if algebra.key(whole) == algebra.key(total):
            return rest
    return Op("sub", (total, part))


def _made(n_inliers: Expr, n_samples: Expr, inliers_in: Expr, samples_in: Expr) -> Counts | None:
    # A constant below the line makes a percentage or a share of it, not a ratio of counts.
    if isinstance(n_samples, Num) or _is_scaled(n_inliers) or _is_scaled(n_samples):
        return None
    if inliers_in.span is None or samples_in.span is None:
        return None
    return Counts(n_inliers, n_samples, inliers_in.span, samples_in.span)


def _is_scaled(expr: Expr) -> bool:
    match algebra.plain(expr):
        case Op(op="mul" | "div", args=args):
            return any(algebra.number(arg) not in (None, 1.0) for arg in args)
    return False


def _is_sum(expr: Expr | None) -> bool:
    """Whether a number is added up over a loop, such as one over several sets of data."""
    match None if expr is None else algebra.plain(expr):
        case Over(kind="sum"):
            return True
        case Op(op="add", args=args):
            return any(_is_sum(arg) for arg in args)
    return False


def _values(counts: Counts, source: Source, place: Span) -> tuple[str, str, str] | str:
    """Spell both counts for another place, and say what must be checked of them, if anything."""
    doubt = ""
    spelled: list[str] = []
    for count, made_at in (
        (counts.n_inliers, counts.inliers_at),
        (counts.n_samples, counts.samples_at),
    ):
        text = source.spell(count)
        if not text or any(mark in text for mark in ("//", "/*", "#")):
            return "the counts cannot be spelled here"
        if source.is_array(count, made_at):
            return _not_a_number(count, source)
        moved = not is_inside(made_at, place)
        if moved and not source.is_repeatable(count):
            return f"{text} would be worked out twice"
        standing = source.standing([count], made_at, place) if moved else "same"
        if standing == "changed":
            return f"{text} may have changed since the ratio was made of it in line {made_at.line}"
        if standing == "unknown":
            doubt = f"; check that {text} has not changed"
        elif not source.is_count(count):
            doubt = doubt or f"; check that {text} is a count"
        spelled.append(text)
    return spelled[0], spelled[1], doubt


# ---- through calls --------------------------------------------------------------------------

_Change = tuple[str, bool, tuple[Edit, ...], str]


def _through_calls(
    read: ReadSite, source: Source, path: str, power: Span, size: str
) -> _Change | str:
    """Make the function of a site take both counts, and its calls give them."""
    site = read.site
    function = site.function
    ratio = site.probability.ratio
    parameter = _ratio_taken(read)
    if function is None or ratio is None or parameter is None:
        return _only_ratio(ratio, source)
    signature = source.signature(function.span, parameter)
    if isinstance(signature, str):
        return f"{_ONLY_RATIO}, and {signature}"
    if not signature.calls:
        where = f"{function.name} is not called in this file"
        return f"{_ONLY_RATIO}, and {where}: let it and its callers pass both counts"
    outliers = not all(isinstance(one, Name) for one in _only(algebra.readings(ratio)))
    changed = _calls(read, signature, source, path, outliers=outliers)
    if isinstance(changed, str):
        return f"{_ONLY_RATIO}, and {changed}"
    calls, doubt = changed
    taken = signature.names
    inliers, samples = (_free(name, taken) for name in ("n_inliers", "n_samples"))
    # Guards and whatever else uses the ratio keep it, made of the same counts again.
    made = source.quotient(inliers, samples)
    if outliers:
        made = f"1 - {made}"
    declared = ", ".join(signature.declared.format(name) for name in (inliers, samples))
    edits = [source.edit(span, declared, path) for span in signature.parameters]
    if not all(is_inside(use, power) for use in signature.uses):
        statement = signature.statement.format(name=parameter, value=made)
        edits.append(source.edit(signature.body, statement, path))
    call = source.probability(inliers, samples, size, power)
    edits += [*source.unused_without(site.assumed, power, call, path), *calls]
    message = f"{_MESSAGE}, with both counts passed to {function.name}"
    if not signature.private:
        doubt = doubt or f"; check that no other file calls {function.name}"
    return f"{message}{doubt}", not doubt, tuple(edits), call


def _ratio_taken(read: ReadSite) -> str | None:
    """Name the parameter that is the ratio of a site, in the function that it stands in."""
    function, ratio = read.site.function, read.site.probability.ratio
    parameter = None if ratio is None else _parameter(ratio)
    if function is None or parameter not in {one.name for one in function.parameters}:
        return None
    return parameter


def callee_of(read: ReadSite) -> str:
    """Name the function of a site if callers give it the ratio; "" otherwise."""
    function = read.site.function
    return "" if function is None or _ratio_taken(read) is None else function.name


def _only_ratio(ratio: Expr | None, source: Source) -> str:
    why = origin(ratio, source.text)
    return f"{_ONLY_RATIO}; {why}" if why else _ONLY_RATIO


def _parameter(ratio: Expr) -> str | None:
    """Name the parameter that a ratio is, within bounds: w itself, or e of 1 - e."""
    for reading in _only(algebra.readings(ratio)):
        match reading:
            case Name(name=name):
                return name
            case Op(op="sub", args=(one, other)) if algebra.number(one) == 1.0:
                for inner in _only(algebra.readings(other)):
                    return inner.name if isinstance(inner, Name) else None
    return None


def _only(readings: Iterator[Expr]) -> tuple[Expr, ...]:
    """Give what a value is where there is one way to read it."""
    two = tuple(islice(readings, 2))
    return two if len(two) == 1 else ()


def _calls(
    read: ReadSite, signature: Signature, source: Source, path: str, *, outliers: bool
) -> tuple[tuple[Edit, ...], str] | str:
    by_call = {one.call: one for one in read.site.seen if one.call is not None}
    edits: list[Edit] = []
    doubt = ""
    for call in signature.calls:
        line = call.span.line
        if call.argument is None:
            return f"the call in line {line} leaves it to its default"
        candidate = by_call.get(call.span)
        probability = None if candidate is None else probability_of(candidate)
        ratio = None if probability is None else probability.ratio
        counts = None if ratio is None else counts_of(ratio)
        if ratio is not None and source.is_array(ratio, call.argument.span):
            return f"in line {line} {_not_a_number(ratio, source)}"
        if counts is not None:
            values = _values(counts, source, call.argument.span)
        else:
            values = _expected_at(read, call.argument, source, outliers=outliers)
        if isinstance(values, str):
            return f"in line {line} {values}"
        inliers, samples, own_doubt = values
        doubt = doubt or own_doubt
        content = f"{inliers}, {samples}"
        if call.argument.keyword:
            content = f"n_inliers={inliers}, n_samples={samples}"
            if {"n_inliers", "n_samples"} & signature.names:
                return f"the call in line {line} has keywords of these names"
        edits.append(source.edit(call.argument.span, content, path))
        if ratio is not None:
            edits += source.unused_without(ratio, call.argument.span, content, path)
    return tuple(edits), doubt


def _expected_at(
    read: ReadSite, argument: Argument, source: Source, *, outliers: bool
) -> tuple[str, str, str] | str:
    """Make the counts of an assumed ratio that a call gives, and of what the sampler draws from."""
    found = None if read.draw is None else source.population(read.draw, argument.span)
    if read.adaptive or found is None or not found[1]:
        given = " ".join(source.text.at(argument.value).split())
        return f"{given} comes without them, too"
    samples, _ = found
    ratio = " ".join(source.text.at(argument.value).split())
    ratio = f"(1 - {_factor(ratio)})" if outliers else _factor(ratio)
    return f"round({ratio} * {_factor(samples)})", samples, "; check the inliers to be expected"


def _free(name: str, taken: frozenset[str]) -> str:
    while name in taken:
        name += "_"
    return name


# ---- budgets --------------------------------------------------------------------------------


def _with_expected_counts(read: ReadSite, source: Source, power: Span, size: str) -> _Change | str:
    """Make the counts of an assumed ratio and of the number of data that the sampler draws from."""
    ratio = read.roles.get("inlier_ratio")
    if ratio is None or read.draw is None:
        return f"{_ONLY_RATIO}, and no sampler that says how many data there are"
    found = source.population(read.draw, power)
    if found is None:
        return f"{_ONLY_RATIO}, and not how many data the sampler draws from"
    population, known = found
    if not known:
        return f"{_ONLY_RATIO}, and the number of data, {population}, is not known yet there"
    if population == size:
        return "the exponent is the number of data, not the size of a sample"
    expected = f"round({_factor(ratio)} * {_factor(population)})"
    message = f"{_MESSAGE}, with the number of inliers to be expected"
    return message, False, (), source.probability(expected, population, size, power)


def _factor(text: str) -> str:
    return text if re.fullmatch(r"[\w.]+(?:\[[\w]+\]|\([\w.]*\))?", text) else f"({text})"


def apply_edits(source: str, edits: Iterable[Edit]) -> str:
    """Make changes to a text; of the same edit twice one is made, and so of two that overlap."""
    starts = [0, *(found.end() for found in re.finditer(r"\r\n|\r|\n", source))]
    pieces: list[str] = []
    done = 0
    spans = {
        (
            starts[edit.location.start_line - 1] + edit.location.start_column - 1,
            starts[edit.location.end_line - 1] + edit.location.end_column - 1,
            edit.content,
        )
        for edit in edits
    }
    for start, end, content in sorted(spans):
        if start >= done:
            pieces += [source[done:start], content]
            done = end
    return "".join([*pieces, source[done:]])

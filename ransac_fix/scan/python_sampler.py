"""Calls that draw samples in Python: what they draw from, and how they draw distinct samples."""

import ast
import re


def population_of(call: ast.Call) -> str | None:
    """Spell the number of data that a call draws from."""
    if not isinstance(call.func, ast.Attribute | ast.Name):
        return None
    name = call.func.attr if isinstance(call.func, ast.Attribute) else call.func.id
    arguments = call.args
    if not arguments:
        return None
    match name:
        case "sample" | "choices":
            if isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) != "random":
                return None
            return _size_of(arguments[0]) or f"len({ast.unparse(arguments[0])})"
        case "choice" | "permutation" | "randperm" | "sample_without_replacement":
            return _size_of(arguments[0])
        case "randint" | "integers" | "random_integers":
            ends = arguments[:2]
            single = isinstance(call.func, ast.Name) or ast.unparse(call.func.value) == "random"
            if len(ends) == 2 and ast.unparse(ends[0]) != "0":
                return None
            return _one_more(ends[-1]) if single else ast.unparse(ends[-1])
        case "randrange":
            return ast.unparse(arguments[0]) if len(arguments) == 1 else None
    return None


def _size_of(node: ast.expr) -> str | None:
    """Spell how many entries ``range(n)``, ``arange(n)`` or a number of data stands for."""
    match node:
        case ast.Call(func=ast.Name(id="range") | ast.Attribute(attr="arange"), args=[size]):
            return ast.unparse(size)
        case ast.Call(func=ast.Name(id="range") | ast.Attribute(attr="arange"), args=[low, size]):
            return ast.unparse(size) if ast.unparse(low) == "0" else None
        case ast.Call(func=ast.Name(id="len")) | ast.Attribute(attr="size"):
            return ast.unparse(node)
        case ast.Subscript(value=ast.Attribute(attr="shape")):
            return ast.unparse(node)
    return None


def _one_more(node: ast.expr) -> str | None:
    """Read n out of n - 1, the largest index."""
    match node:
        case ast.BinOp(left=left, op=ast.Sub(), right=ast.Constant(value=1)):
            return ast.unparse(left)
    return None


def distinct(call: ast.Call) -> str | None:
    """Spell a call that draws with replacement so that it draws without."""
    if not isinstance(call.func, ast.Attribute):
        return None
    base = ast.unparse(call.func.value)
    names = {word.arg: word.value for word in call.keywords}
    arguments = [ast.unparse(argument) for argument in call.args]
    match call.func.attr:
        case "choice":
            words = [f"{word.arg}={ast.unparse(word.value)}" for word in call.keywords]
            words = [word for word in words if not word.startswith("replace=")]
            return f"{base}.choice({', '.join([*arguments[:2], *words, 'replace=False'])})"
        case "choices" if "k" in names and len(arguments) == 1 and "weights" not in names:
            return f"{base}.sample({arguments[0]}, k={ast.unparse(names['k'])})"
        case "randint" | "integers" if base != "torch" and not {"endpoint", "dtype"} & set(names):
            size = arguments[2] if len(arguments) > 2 else None
            if "size" in names:
                size = ast.unparse(names["size"])
            low, high = ("0", arguments[0]) if len(arguments) == 1 else arguments[:2]
            several = re.match(r"\(.*,.*\w.*\)", size or "")  # several samples at once
            if size is not None and low == "0" and not several:
                return f"{base}.choice({high}, size={size}, replace=False)"
    return None


def distinct_list(node: ast.ListComp, draw: ast.Call) -> str | None:
    """Spell ``[random.randrange(n) for _ in range(k)]`` so that it draws without replacement."""
    match node:
        case ast.ListComp(
            elt=element,
            generators=[
                ast.comprehension(
                    target=ast.Name(id=counter),
                    iter=ast.Call(func=ast.Name(id="range"), args=[size]),
                    ifs=[],
                )
            ],
        ):
            pass
        case _:
            return None
    population = population_of(draw)
    function = draw.func
    if (
        population is None
        or not isinstance(function, ast.Attribute)
        or counter in re.findall(r"\w+", population)
    ):
        return None
    if ast.unparse(function.value) != "random":
        return None
    sample = f"random.sample(range({population}), {ast.unparse(size)})"
    if element is draw:
        return sample
    match element:
        case ast.Subscript(value=ast.Name() as data, slice=index) if index is draw:
            return f"[{ast.unparse(data)}[i] for i in {sample}]"
    return None

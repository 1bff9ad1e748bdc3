"""Random mutants of GLSL and Python text: one operator, comparison, constant, swizzle, function or term changed each.

Sites are found in code only: not in comments, strings, annotations, imports, preprocessor lines or declarations of
bindings.  Python sites come from the syntax tree, GLSL sites from tokens.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True, slots=True)
class Mutant:
    """``text[start:end]`` of ``file`` becomes ``replacement``."""

    file: str
    start: int
    end: int
    replacement: str
    line: int
    old: str

    def apply(self, text: str) -> str:
        return text[: self.start] + self.replacement + text[self.end :]

    @property
    def name(self) -> str:
        return f"{self.file}:{self.line}: {' '.join(self.old.split())} -> {self.replacement or '(nothing)'}"


Site = tuple[int, int, tuple[str, ...]]
"""Start, end, replacements."""

OPERATORS = {"+": ("-",), "-": ("+",), "*": ("/", "+"), "/": ("*",), "**": ("*",), "//": ("/",), "%": ("*",)}
COMPARISONS = {
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
}  # fmt: skip
LOGIC = {"and": ("or",), "or": ("and",), "&&": ("||",), "||": ("&&",)}
BITS = {"&": ("|",), "|": ("&",), "<<": (">>",), ">>": ("<<",), "^": ("|",)}
FUNCTIONS = {
    "min": ("max",), "max": ("min",), "minimum": ("maximum",), "maximum": ("minimum",), "sin": ("cos",),
    "cos": ("sin",), "floor": ("ceil",), "ceil": ("floor",), "any": ("all",), "all": ("any",), "abs": ("",),
    "sqrt": ("",), "normalize": ("",), "radians": ("degrees",), "degrees": ("radians",), "argmin": ("argmax",),
    "argmax": ("argmin",), "lessThan": ("lessThanEqual",), "greaterThan": ("greaterThanEqual",),
    "greaterThanEqual": ("greaterThan",), "lessThanEqual": ("lessThan",), "round": ("floor",), "dot": ("distance",),
}  # fmt: skip


COST_ONLY = {
    "taubench_gl/animation/views.py": {"_HULL_POINTS": "clouds of fewer points are not reduced to their hull"},
    "taubench_gl/evaluation/session.py": {
        "TIMED_FIRST": "frames whose passes are timed, in profile.json alone",
        "TIMED_EVERY": "frames whose passes are timed, in profile.json alone",
    },
    "taubench_gl/frame/lights.py": {"LIGHT_ROW": "columns of a table; shaders get the same number"},
    "taubench_gl/frame/passes/deform.py": {"GROUP": "vertices of a work group"},
    "taubench_gl/frame/passes/indirect.py": {"VPL_ROW": "columns of a table; shaders get the same number"},
    "taubench_gl/frame/passes/pathtracing.py": {
        "LIGHT_CHUNK": "lights of a dispatch; their sum has the same order",
        "LIST_TILE": "pixels of a dispatch",
        "TABLE_ROWS": "samples whose numbers are uploaded at a time",
    },
    "taubench_gl/frame/raytracing/bvh.py": {
        "NODE_COST": "shape of a tree; every tree gives the same nearest hit",
        "TRIANGLE_COST": "shape of a tree; every tree gives the same nearest hit",
        "BINS": "shape of a tree; every tree gives the same nearest hit",
        "PAIR": "shape of a tree; every tree gives the same nearest hit",
    },
    "taubench_gl/frame/raytracing/refit.py": {"GROUP": "nodes of a work group"},
    "taubench_gl/frame/shadow_faces.py": {"FACE_ROW": "columns of a table; shaders get the same number"},
}
"""Constants that change time or layout and no result, by file, and why.  No mutants are drawn from their values.

Limits above which something is refused or made smaller are not among them, nor are constants that only bound an error.
"""


def sites(file: str, text: str) -> list[Site]:
    """Every place of ``text`` that can be mutated, without the values of COST_ONLY."""
    found = set(python_sites(text) if file.endswith(".py") else glsl_sites(text))
    cost_only = [values_of(text, name) for name in COST_ONLY.get(file, ())]
    return sorted(site for site in found if not any(start <= site[0] < end for start, end in cost_only))


def values_of(text: str, name: str) -> tuple[int, int]:
    """Start and end of the line that assigns the constant ``name`` of a Python module.  ValueError if none does."""
    for match in re.finditer(r"^(\w+(?:, \w+)*) = [^\n]+", text, re.M):
        if name in match[1].split(", "):
            return match.span()
    raise ValueError(f"no constant is named {name}")


def draw(root: Path, files: Sequence[str], seed: int) -> Iterator[Mutant]:
    """Mutants of ``files`` below ``root`` without end: every site is equally likely, none is drawn twice."""
    texts = {file: (root / file).read_text(encoding="utf-8") for file in files}
    every = [(file, site) for file, text in texts.items() for site in sites(file, text)]
    random = np.random.default_rng(seed)
    for i in random.permutation(len(every)):
        file, (start, end, replacements) = every[i]
        text = texts[file]
        replacement = replacements[random.integers(len(replacements))]
        yield Mutant(file, start, end, replacement, text.count("\n", 0, start) + 1, text[start:end])


# ----------------------------------------------------------------------------------------------------------------- GLSL
_SKIPPED = re.compile(
    r"//[^\n]*|/\*.*?\*/|^[ \t]*\#[^\n]*(?:\\\n[^\n]*)*|\blayout\s*\([^)]*\)|\bfor\s*\([^;{]*;[^;{]*;[^;{)]*\)",
    re.S | re.M,
)
_TOKEN = re.compile(
    r"(?P<number>(?<![\w.])(?:\d+\.\d*(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+|0x[0-9a-fA-F]+u?|\d+u?)(?![\w.]))"
    r"|(?P<swizzle>\.(?:[xyzw]{1,4}|[rgba]{1,4})\b(?!\s*\())"
    r"|(?P<word>[A-Za-z_]\w*)"
    r"|(?P<operator>\+\+|--|[-+*/%&|^]=|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%<>&|^!])"
)
_OPERAND = re.compile(r"\s*[A-Za-z_]\w*(?:\.\w+)*")


def glsl_sites(text: str) -> Iterator[Site]:
    """Sites of GLSL: operators, comparisons, constants, swizzles, functions, factors and terms."""
    bare = _SKIPPED.sub(lambda m: re.sub(r"[^\n]", " ", m.group()), text)
    depth_of_functions = _inside_functions(bare)
    for match in _TOKEN.finditer(bare):
        start, end, token = match.start(), match.end(), match.group()
        inside = depth_of_functions[start]
        if match.lastgroup == "number":
            yield start, end, _numbers(token)
        elif not inside:
            continue
        elif match.lastgroup == "swizzle":
            yield start, end, _swizzles(token)
        elif match.lastgroup == "word":
            if token in FUNCTIONS and bare[end : end + 1] == "(":
                yield start, end, FUNCTIONS[token]
        elif token == "!":
            yield start, end, ("",)
        else:
            yield from _glsl_operator(bare, start, end, token)


def _glsl_operator(bare: str, start: int, end: int, token: str) -> Iterator[Site]:
    before = bare[:start].rstrip()[-1:]
    binary = before.isalnum() or before in ("_", ")", "]")
    if binary and re.search(r"\b(return|case)$", bare[:start].rstrip()):
        binary = False
    if not binary:
        if token == "-":
            yield start, end, ("",)
        return
    table = OPERATORS | COMPARISONS | LOGIC | BITS
    if token in table:
        yield start, end, table[token]
    elif token in ("+=", "-=", "*=", "/="):
        yield start, end, ({"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*="}[token], "=")
    if token in ("+", "-", "*", "/", "&&", "||"):  # without the operand that follows
        stop = _end_of_operand(bare, end)
        if stop:
            yield start, stop, ("",)


def _end_of_operand(bare: str, start: int) -> int:
    """End of a name, a call or a parenthesis that begins at ``start``; 0 where it is none of them."""
    match = _OPERAND.match(bare, start)
    stop = match.end() if match else start + (len(bare[start:]) - len(bare[start:].lstrip()))
    if bare[stop : stop + 1] == "(":
        depth = 0
        for i in range(stop, len(bare)):
            depth += (bare[i] == "(") - (bare[i] == ")")
            if not depth:
                return i + 1
        return 0
    return stop if match and bare[stop : stop + 1] != "[" else 0


def _inside_functions(bare: str) -> list[bool]:
    """Whether each character is inside the braces of a function, not of a struct or block."""
    inside, stack = [], []
    for i, c in enumerate(bare):
        if c == "{":
            stack.append(bare[:i].rstrip().endswith(")") or bool(stack and stack[-1]))
        elif c == "}" and stack:
            stack.pop()
        inside.append(bool(stack and stack[-1]))
    return inside


def _numbers(token: str) -> tuple[str, ...]:
    if token.startswith("0x"):
        return (f"0x{int(token.rstrip('u'), 16) >> 1:x}" + "u" * token.endswith("u"),)
    if token.rstrip("u").isdigit():
        value, unsigned = int(token.rstrip("u")), "u" * token.endswith("u")
        return tuple(f"{other}{unsigned}" for other in {value + 1, max(value - 1, 0)} - {value})
    value = float(token)
    return (repr(value + 1.0), repr(value * 2.0 or 0.5), "0.0" if value else "1.0")


def _swizzles(token: str) -> tuple[str, ...]:
    letters = next(s for s in ("xyzw", "rgba") if set(token[1:]) <= set(s))
    used = token[1:]
    if len(used) == 1:
        other = letters[(letters.index(used) + 1) % 2] if used in letters[:2] else letters[letters.index(used) - 1]
        return (f".{other}",)
    turned = used[::-1]
    return (f".{turned}",) if turned != used else (f".{used[1:]}{letters[used[0] == letters[0]]}",)


# --------------------------------------------------------------------------------------------------------------- Python
_AST_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.FloorDiv: "//", ast.Mod: "%",
    ast.BitAnd: "&", ast.BitOr: "|", ast.LShift: "<<", ast.RShift: ">>", ast.BitXor: "^",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.And: "and", ast.Or: "or",
}  # fmt: skip


def python_sites(text: str) -> Iterator[Site]:
    """Sites of Python, from its syntax tree."""
    tree = ast.parse(text)
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    lines = text.splitlines(keepends=True)

    def at(line: int, column: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def begin(node: ast.AST) -> int:
        return at(node.lineno, node.col_offset)

    def end(node: ast.AST) -> int:
        return at(node.end_lineno, node.end_col_offset)

    def between(left: ast.AST, right: ast.AST, token: str) -> tuple[int, int] | None:
        start = text.find(token, end(left), begin(right))
        return None if start < 0 else (start, start + len(token))

    for node in _code(tree):
        if isinstance(node, ast.BinOp | ast.BoolOp | ast.Compare):
            yield from _python_operators(node, between, begin, end, text)
        elif isinstance(node, ast.AugAssign) and type(node.op) in (ast.Add, ast.Sub, ast.Mult, ast.Div):
            token = _AST_OPERATORS[type(node.op)]
            place = between(node.target, node.value, token + "=")
            if place:
                yield *place, ({"+": "-=", "-": "+=", "*": "/=", "/": "*="}[token], "=")
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            yield begin(node), begin(node.operand), ("",)
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield begin(node), end(node), _numbers(repr(node.value))
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if FUNCTIONS.get(name, ("",)) != ("",):
                yield end(node.func) - len(name), end(node.func), FUNCTIONS[name]
            elif name in FUNCTIONS and len(node.args) == 1 and not node.keywords:
                yield begin(node), end(node.func), ("",)


def _python_operators(node, between, begin, end, text: str) -> Iterator[Site]:
    """The operator of a node; also either operand alone."""
    if isinstance(node, ast.Compare):
        operands, operators = [node.left, *node.comparators], node.ops
    elif isinstance(node, ast.BoolOp):
        operands, operators = node.values, [node.op] * (len(node.values) - 1)
    else:
        operands, operators = [node.left, node.right], [node.op]
    table = OPERATORS | COMPARISONS | LOGIC | BITS
    for left, right, operator in zip(operands, operands[1:], operators, strict=False):
        token = _AST_OPERATORS.get(type(operator))
        place = token and between(left, right, token)
        if place:
            yield *place, table[token]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.Mult | ast.Div):
        yield begin(node), end(node), (text[begin(node.left) : end(node.left)],)


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes of ``tree`` that compute, not those of annotations, strings, ``raise`` and ``assert``."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            skipped = isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert | ast.Import | ast.ImportFrom)
            if isinstance(node, ast.AST) and not skipped and not _is_text(node):
                yield node
                yield from _code(node)


def _is_text(node: ast.AST) -> bool:
    """An operation on text or types: ``"a" + b``, ``"%s" % x``, ``X | None`` of an alias."""
    if not isinstance(node, ast.BinOp):
        return False
    constants = (p for p in (node.left, node.right) if isinstance(p, ast.Constant | ast.JoinedStr))
    return any(isinstance(p, ast.JoinedStr) or not isinstance(p.value, int | float) for p in constants)

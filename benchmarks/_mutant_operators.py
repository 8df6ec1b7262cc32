"""Mutation operators: for each place of a module, the small mistakes that a programmer could make there.

The syntax tree gives the places; a mutant changes the text of its place and nothing else. Text constants,
annotations, decorators and imports are left out. So are `assert` and `zip(strict=…)`: they state what holds.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

BOUNDARY = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
COMPARISON = {
    "<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "==",
    "is": "is not", "is not": "is", "in": "not in", "not in": "in",
}  # fmt: skip
ARITHMETIC = {
    "+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "**": "*", "&": "|", "|": "&", "^": "&",
    "<<": ">>", ">>": "<<", "@": "@",
}  # fmt: skip
"""Of `a @ b` the operands change places: poses do not commute."""
ROUNDING = 1e-6
"""Greatest constant that only keeps rounding errors away: twice of it is no mistake."""
_SYMBOLS: dict[type[ast.AST], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.Is: "is", ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in",
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%",
    ast.Pow: "**", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^", ast.LShift: "<<", ast.RShift: ">>",
    ast.MatMult: "@", ast.And: "and", ast.Or: "or",
}  # fmt: skip
_EMPTY = {
    ast.List: "[]", ast.ListComp: "[]", ast.Tuple: "()", ast.Dict: "{}", ast.DictComp: "{}",
    ast.Set: "set()", ast.SetComp: "set()",
}  # fmt: skip
_TRUTH = (ast.Compare, ast.BoolOp)
_TYPE_HOLDERS = ("list", "dict", "set", "frozenset", "tuple", "deque", "defaultdict", "Counter", "type")
_TEXTS = ("feedback_message",)
"""Attributes that hold a text for people."""
_ONLY_TYPES = ("TypeVar", "ParamSpec", "NewType", "TYPE_CHECKING", "__name__")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one place in a source file."""

    file: str
    """Path in the checkout, with slashes."""
    function: str
    """Qualified name of the function or class around the place; empty at the level of the module."""
    operator: str
    start: int
    """Offsets of the place in the source, in characters."""
    end: int
    text: str
    """What stands there instead."""
    line: int
    """Number of the first line of the place, from 1."""
    before: str
    """Text of that line, without indentation."""
    after: str
    """The same of the mutant."""
    nth: int = 0
    """Which of the places in the function that look the same."""
    near: frozenset[int] = frozenset()
    """Lines in functions whose run tells that the place does, or that use what it declares."""
    far: frozenset[int] = frozenset()
    """Lines that do as well when nothing runs the near ones."""
    declares: bool = False
    """Whether the place runs at import alone: then the far lines count beside the near ones."""

    @property
    def place(self) -> tuple[str, int, int]:
        return self.file, self.start, self.end

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """What survives that lines move: file, function, operator, and the text of the line in both."""
        return self.file, self.function, self.operator, self.before, self.after

    @property
    def identity(self) -> str:
        """The key, and which of several alike it is."""
        return "\n".join((*self.key, str(self.nth)))

    @property
    def module(self) -> str:
        """Name of the module in Python."""
        return "picktree." + self.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")

    def source(self, original: str) -> str:
        """The whole text of the mutated module."""
        return original[: self.start] + self.text + original[self.end :]


def mutants(file: str, source: str, functions: Iterable[str] = ()) -> list[Mutant]:
    """All mutants of a module, in the order of their places. `functions`: only within these, if any."""
    wanted = tuple(functions)
    found = _Finder(file, source).found()
    if wanted:
        unknown = set(wanted) - {mutant.function for mutant in found}
        if unknown:
            raise ValueError(f"{file} has nothing to mutate in {', '.join(sorted(unknown))}")
        found = [mutant for mutant in found if mutant.function in wanted]
    return _numbered(found, source)


def sample(found: Sequence[Mutant], runs: int, seed: int) -> list[Mutant]:
    """One mutant of each of so many places, all places being equally likely.

    The order comes from a hash of what a place looks like: a change elsewhere leaves the sample as it is,
    but for what was added or taken away, and a smaller sample is the beginning of a larger one.
    """
    variants: dict[tuple[str, int, int], list[Mutant]] = {}
    for mutant in found:
        variants.setdefault(mutant.place, []).append(mutant)
    # Places are ordered by another hash than variants: the least of several is smaller than that of one.
    places = sorted(variants.values(), key=lambda each: _rank(each[0], seed, "place"))[:runs]
    return [min(each, key=lambda mutant: _rank(mutant, seed, "variant")) for each in places]


def _rank(mutant: Mutant, seed: int, what: str) -> bytes:
    return hashlib.sha256(f"{seed}\n{what}\n{mutant.identity}".encode()).digest()


def _numbered(found: list[Mutant], source: str) -> list[Mutant]:
    """Mutants that look the same, counted."""
    seen: Counter[tuple[str, ...]] = Counter()
    numbered: list[Mutant] = []
    for mutant in found:
        values = {name: getattr(mutant, name) for name in Mutant.__slots__}
        numbered.append(Mutant(**values | {"nth": seen[mutant.key]}))
        seen[mutant.key] += 1
    return numbered


@dataclass
class _Scope:
    """Where the walk is."""

    name: str = ""
    statement: ast.stmt | None = None
    body: tuple[int, int] | None = None
    """Lines of the body of the innermost function; None outside of functions."""
    initial: bool = False
    """In `__init__`: there what is not set is missed at once."""
    declares: str | None = None
    """Name that a statement outside of functions sets, or a parameter whose default this is."""
    header: tuple[int, int] | None = None
    """Lines of the body of the function whose defaults these are."""


@dataclass
class _Finder:
    file: str
    source: str
    _found: list[Mutant] = field(default_factory=list[Mutant])

    def __post_init__(self) -> None:
        self._lines = self.source.splitlines(keepends=True)
        self._offsets = [0, *accumulate(map(len, self._lines))]
        self._tokens = [
            (self._offsets[t.start[0] - 1] + t.start[1], self._offsets[t.end[0] - 1] + t.end[1], t.string)
            for t in tokenize.generate_tokens(io.StringIO(self.source).readline)
            if t.type in (tokenize.OP, tokenize.NAME, tokenize.NUMBER, tokenize.STRING)
        ]
        self._tree = ast.parse(self.source)
        self._bodies = lines_in_functions(self._tree)

    def found(self) -> list[Mutant]:
        self._block(self._tree.body, _Scope())
        return sorted(self._found, key=lambda mutant: (mutant.start, mutant.end))

    # The walk.

    def _block(self, statements: Sequence[ast.stmt], scope: _Scope) -> None:
        for statement in statements:
            self._statement(statement, scope)

    def _statement(self, node: ast.stmt, scope: _Scope) -> None:
        here = _Scope(**{**vars(scope), "statement": node})
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                self._function(node, scope)
            case ast.ClassDef():
                self._block(node.body, _Scope(_joined(scope.name, node.name), body=scope.body))
            case ast.Import() | ast.ImportFrom() | ast.Assert() | ast.Global() | ast.Nonlocal():
                pass
            case ast.If() if _names(node.test) & set(_ONLY_TYPES):
                self._block(node.orelse, scope)
            case ast.Assign() | ast.AnnAssign() if _states_types(node):
                pass
            case ast.Assign() | ast.AnnAssign() if scope.body is None:
                for name, value in _declared(node):
                    self._expression(value, _Scope(**{**vars(here), "declares": name}))
            case _:
                if scope.body is not None:
                    self._deleted(node, here)
                    self._returned(node, here)
                self._parts(node, here)

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef, scope: _Scope) -> None:
        name = _joined(scope.name, node.name)
        body = (node.body[0].lineno, node.body[-1].end_lineno or node.body[-1].lineno)
        arguments = (*node.args.posonlyargs, *node.args.args)
        defaults = [
            *zip(arguments[len(arguments) - len(node.args.defaults) :], node.args.defaults, strict=True),
            *zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True),
        ]
        for argument, default in defaults:
            if default is not None:
                self._expression(default, _Scope(name, node, declares=argument.arg, header=body))
        self._block(node.body, _Scope(name, body=body, initial=node.name in ("__init__", "__post_init__")))

    def _parts(self, node: ast.AST, scope: _Scope) -> None:
        """Statements and expressions right within a node."""
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "type_comment"):
                continue
            for each in value if isinstance(value, list) else [value]:
                if isinstance(each, ast.stmt):
                    self._statement(each, scope)
                elif isinstance(each, ast.expr):
                    self._expression(each, scope)
                elif isinstance(each, ast.AST):  # handlers, keywords, cases, comprehensions
                    self._parts(each, scope)
        match node:
            case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
                self._negated(test, scope)
            case ast.match_case(guard=ast.expr() as guard):
                self._negated(guard, scope)
            case ast.comprehension(ifs=tests):
                for test in tests:
                    self._negated(test, scope)
            case _:
                pass

    def _expression(self, node: ast.expr, scope: _Scope) -> None:
        match node:
            case ast.JoinedStr():
                return
            case ast.Call(func=ast.Name(id=called)) if called in _ONLY_TYPES:
                return
            case ast.Call(func=ast.Name(id="cast")):
                self._expression(node.args[1], scope)
                return
            case ast.Call(func=ast.Name(id="isinstance" | "issubclass")):
                self._expression(node.args[0], scope)
                return
            case ast.Call(func=ast.Name(id="zip")):
                for argument in node.args:
                    self._expression(argument, scope)
                return
            case ast.Subscript(value=ast.Name(id=held)) if held in _TYPE_HOLDERS:
                return
            case ast.Constant(value=bool() | int() | float()):
                self._constant(node, scope)
            case ast.Compare():
                lefts = (node.left, *node.comparators)
                for left, operator, right in zip(lefts, node.ops, node.comparators, strict=False):
                    symbol = _SYMBOLS[type(operator)]
                    at = self._between(left, right, symbol)
                    if symbol in BOUNDARY:
                        self._add("boundary", *at, BOUNDARY[symbol], scope)
                    self._add("comparison", *at, COMPARISON[symbol], scope)
            case ast.BoolOp():
                symbol = _SYMBOLS[type(node.op)]
                for left, right in zip(node.values, node.values[1:], strict=False):
                    at = self._between(left, right, symbol)
                    self._add("and/or", *at, "or" if symbol == "and" else "and", scope)
            case ast.BinOp() if not any(_is_text_or_sequence(side) for side in (node.left, node.right)):
                self._arithmetic(node, scope)
            case ast.UnaryOp(op=ast.Not()):
                start = self._start(node)
                after = next(begin for begin, _, _ in self._tokens if begin > start)
                self._add("not", start, after, "", scope)
            case ast.UnaryOp(op=ast.USub()):
                self._add("arithmetic", self._start(node), self._start(node) + 1, "", scope)
            case ast.Lambda():
                self._expression(node.body, scope)
                return
            case _:
                pass
        self._parts(node, scope)

    # The operators.

    def _constant(self, node: ast.Constant, scope: _Scope) -> None:
        value, at = node.value, (self._start(node), self._end(node))
        if isinstance(value, bool):
            self._add("constant", *at, repr(not value), scope)
            return
        assert isinstance(value, int | float)
        half = value // 2 if isinstance(value, int) else value * 0.5
        others = (value * 2, half, value + 1) if abs(value) > ROUNDING else (value + 1,)
        for other in dict.fromkeys(others):
            if other != value:
                self._add("constant", *at, repr(other), scope)

    def _arithmetic(self, node: ast.BinOp, scope: _Scope) -> None:
        symbol = _SYMBOLS[type(node.op)]
        at = self._between(node.left, node.right, symbol)
        if symbol != "@":
            self._add("arithmetic", *at, ARITHMETIC[symbol], scope)
            return
        start, end = self._start(node), self._end(node)
        left, right = self.source[start : at[0]].strip(), self.source[at[1] : end].strip()
        if left != right:
            self._add("arithmetic", start, end, f"({right}) @ ({left})", scope)

    def _negated(self, test: ast.expr, scope: _Scope) -> None:
        """A condition that has no comparison or junction of its own to change."""
        if isinstance(test, (*_TRUTH, ast.Constant)) or isinstance(getattr(test, "op", None), ast.Not):
            return
        start, end = self._start(test), self._end(test)
        text = self.source[start:end]
        plain = isinstance(test, ast.Name | ast.Attribute | ast.Call | ast.Subscript)
        self._add("not", start, end, f"not {text}" if plain else f"not ({text})", scope)

    def _returned(self, node: ast.stmt, scope: _Scope) -> None:
        if not isinstance(node, ast.Return) or node.value is None:
            return
        value, start, end = node.value, self._start(node.value), self._end(node.value)
        match value:
            case ast.Constant() | ast.Yield() | ast.YieldFrom() | ast.Await():
                return
            case ast.UnaryOp(op=ast.Not()) | ast.Compare():  # these have operators of their own
                return
            case ast.BoolOp():
                text = f"not ({self.source[start:end]})"
            case _:
                text = _EMPTY.get(type(value), "None")
        if text != self.source[start:end]:
            self._add("return", start, end, text, scope)

    def _deleted(self, node: ast.stmt, scope: _Scope) -> None:
        at = self._start(node), self._end(node)
        match node:
            case ast.Break():
                self._add("break", *at, "continue", scope)
            case ast.Continue():
                self._add("break", *at, "break", scope)
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr() | ast.Raise() | ast.Delete() | ast.Return(value=None):
                self._add("deletion", *at, "pass", scope)
            case ast.AugAssign():
                self._add("deletion", *at, "pass", scope)
                symbol = _SYMBOLS[type(node.op)]
                between = self._between(node.target, node.value, symbol + "=")
                if symbol != "@":
                    self._add("arithmetic", *between, ARITHMETIC[symbol] + "=", scope)
            case ast.Assign(targets=[ast.Attribute(attr=name), *_]) if scope.initial or name in _TEXTS:
                pass
            case ast.Assign(targets=[ast.Attribute() | ast.Subscript(), *_]):
                self._add("deletion", *at, "pass", scope)
            case _:
                pass

    # Places in the text.

    def _add(self, operator: str, start: int, end: int, text: str, scope: _Scope) -> None:
        line = bisect_right(self._offsets, start)
        rest, _, _ = self.source[end:].partition("\n")
        changed = self.source[self._offsets[line - 1] : start] + text + rest
        self._found.append(
            Mutant(
                self.file, scope.name, operator, start, end, text, line,
                self._lines[line - 1].strip(), changed.splitlines()[0].strip(),
                **self._running(line, scope),
            )
        )  # fmt: skip

    def _running(self, line: int, scope: _Scope) -> dict[str, object]:
        """See `Mutant.near`."""
        if scope.body is not None:
            assert scope.statement is not None
            own = _header(scope.statement)
            return {"near": frozenset((line,)), "far": frozenset(own) - {line}}
        bodies = range(scope.header[0], scope.header[1] + 1) if scope.header else self._bodies
        using = _lines_naming(self._tree, scope.declares) & set(bodies) if scope.declares else set[int]()
        return {"near": frozenset(using), "far": frozenset(bodies) - using, "declares": True}

    def _start(self, node: ast.expr | ast.stmt) -> int:
        return self._offset(node.lineno, node.col_offset)

    def _end(self, node: ast.expr | ast.stmt) -> int:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return self._offset(node.end_lineno, node.end_col_offset)

    def _offset(self, line: int, column: int) -> int:
        """Of a position of the syntax tree, whose columns count bytes of UTF-8."""
        text = self._lines[line - 1].encode()[:column].decode()
        return self._offsets[line - 1] + len(text)

    def _between(self, left: ast.expr, right: ast.expr, symbol: str) -> tuple[int, int]:
        """Where the operator between two operands stands; nothing but brackets and comments is there, too."""
        low, high, words = self._end(left), self._start(right), symbol.split()
        inside = [token for token in self._tokens if low <= token[0] and token[1] <= high]
        for first, last in zip(inside, inside[len(words) - 1 :], strict=False):
            if first[2] == words[0] and last[2] == words[-1]:
                return first[0], last[1]
        raise ValueError(f"{self.file}:{left.end_lineno}: no {symbol!r} after the operand")


def _joined(outer: str, name: str) -> str:
    return f"{outer}.{name}" if outer else name


def _names(node: ast.AST) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def _states_types(node: ast.Assign | ast.AnnAssign) -> bool:
    """Whether an assignment declares a type or what the module exports."""
    if isinstance(node, ast.AnnAssign):
        return "TypeAlias" in _names(node.annotation)
    return bool(_names(node.targets[0]) & {"__all__", "__slots__"})


def _declared(node: ast.Assign | ast.AnnAssign) -> list[tuple[str | None, ast.expr]]:
    """Values that are assigned, each with its name."""
    target, value = node.targets[0] if isinstance(node, ast.Assign) else node.target, node.value
    if value is None:
        return []
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        pairs = list(zip(target.elts, value.elts, strict=True))
    else:
        pairs = [(target, value)]
    return [(name.id if isinstance(name, ast.Name) else None, each) for name, each in pairs]


def _is_text_or_sequence(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    )


def _header(node: ast.stmt) -> range:
    """Lines of a statement without the blocks within it."""
    blocks = [each for name in ("body", "cases", "handlers") for each in getattr(node, name, ())]
    first = min((_first_line(each) for each in blocks), default=None)
    end = node.end_lineno or node.lineno
    return range(node.lineno, end + 1 if first is None else max(first, node.lineno + 1))


def _first_line(node: ast.AST) -> int:
    return min(each.lineno for each in ast.walk(node) if isinstance(each, ast.stmt | ast.expr))


def lines_in_functions(tree: ast.Module) -> frozenset[int]:
    """Lines in functions, but for their headers."""
    functions = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef))
    return frozenset(
        line
        for function in functions
        for line in range(function.body[0].lineno, (function.end_lineno or function.lineno) + 1)
    )


def _lines_naming(tree: ast.Module, name: str) -> set[int]:
    """Lines where a name is read, or an attribute of that name."""
    return set(_reading(tree, name))


def _reading(tree: ast.Module, name: str) -> Iterator[int]:
    for each in ast.walk(tree):
        if isinstance(each, ast.Name) and each.id == name and isinstance(each.ctx, ast.Load):
            yield each.lineno
        elif isinstance(each, ast.Attribute) and each.attr == name:
            yield each.end_lineno or each.lineno

"""Names that the product's modules define: classes, public functions, constants."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from .source import House, Module, nested

_CONSTANT = re.compile(r"_*[A-Z][A-Z0-9_]*")
_TYPE_VARIABLES = ("TypeVar", "TypeVarTuple", "ParamSpec", "NewType")


@dataclass(frozen=True)
class Definition:
    """A name at the top of a module."""

    name: str
    file: str
    line: int
    value: str = ""
    """Literal value of a constant; empty: none."""


def classes(house: House) -> list[Definition]:
    return [
        Definition(node.name, file.file, node.lineno)
        for file, node in _statements(house)
        if isinstance(node, ast.ClassDef)
    ]


def public_functions(house: House) -> list[Definition]:
    return [
        Definition(node.name, file.file, node.lineno)
        for file, node in _statements(house)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_")
    ]


def constants(house: House) -> list[Definition]:
    """Return the assignments to names in capitals. Type variables are no constants."""
    found = list[Definition]()
    for file, node in _statements(house):
        match node:
            case ast.Assign(value=value):
                targets = node.targets
            case ast.AnnAssign(value=ast.expr() as value):
                targets = [node.target]
            case _:
                continue
        if isinstance(value, ast.Call) and _last_name(value.func) in _TYPE_VARIABLES:
            continue
        found += [
            Definition(part.id, file.file, node.lineno, literal(value) if part is target else "")
            for target in targets
            for part in ast.walk(target)
            if isinstance(part, ast.Name) and _CONSTANT.fullmatch(part.id)
        ]
    return found


def literal(value: ast.expr) -> str:
    """Return the text of a literal value, the same for each way to write it; empty when it is none."""
    try:
        return repr(ast.literal_eval(value))
    except (ValueError, TypeError):
        return ""


def in_several_modules(definitions: Iterable[Definition]) -> dict[str, list[Definition]]:
    """Return the definitions of each name that more than one module defines, the most frequent first."""
    named = defaultdict[str, list[Definition]](list)
    for definition in definitions:
        named[definition.name].append(definition)
    return _repeated(named)


def with_equal_value(definitions: Iterable[Definition]) -> dict[str, list[Definition]]:
    """Return the definitions of each constant that has the same literal value in several modules."""
    valued = defaultdict[str, list[Definition]](list)
    for definition in definitions:
        if definition.value:
            valued[f"{definition.name} = {definition.value}"].append(definition)
    return _repeated(valued)


def _repeated(grouped: Mapping[str, list[Definition]]) -> dict[str, list[Definition]]:
    several = [(name, found) for name, found in grouped.items() if len({one.file for one in found}) > 1]
    return dict(sorted(several, key=lambda entry: (-len(entry[1]), entry[0])))


def _statements(house: House) -> Iterator[tuple[Module, ast.stmt]]:
    for file in house.files.values():
        for statement in _top(file.tree.body):
            yield file, statement


def _top(suite: Iterable[ast.AST]) -> Iterator[ast.stmt]:
    """Yield the statements that define names of the module, those below `if`, `try` and the like, too."""
    for node in suite:
        if isinstance(node, ast.stmt):
            yield node
        if isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case) and not isinstance(
            node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        ):
            yield from _top(nested(node))


def _last_name(function: ast.expr) -> str:
    match function:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""

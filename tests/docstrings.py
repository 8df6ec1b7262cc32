"""Docstrings of the product, and what is wrong with the wording of each."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

OBSCURE_FIRST_WORDS = frozenset(
    ("Of", "What", "Who", "Whoever", "That", "With", "By", "From", "In", "On", "To", "For", "Upon")
)
MAX_WORDS = 25
"""Length of a sentence."""

_PARAGRAPH_END = re.compile(r"\n[ \t]*\n|\n(?=[ \t]*(?:[-*•]|\d+[.)]) )")
_SENTENCE_END = re.compile(r"(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)(?<!cf\.)(?<!al\.)[)\"'”]*\s+(?![a-z])")
_LITERAL = ("    ", ">>>")
"""Beginnings of paragraphs that are no prose."""


@dataclass(frozen=True)
class Docstring:
    line: int
    text: str

    @property
    def first_line(self) -> str:
        return self.text.partition("\n")[0]

    @property
    def has_obscure_first_word(self) -> bool:
        word = re.match(r"\W*(\w+)", self.text)
        return word is not None and word[1] in OBSCURE_FIRST_WORDS

    @property
    def lengths(self) -> list[int]:
        """Words of each sentence."""
        return [len(re.findall(r"\S*\w\S*", sentence)) for sentence in sentences(self.text)]

    @property
    def has_long_first_sentence(self) -> bool:
        return max(self.lengths[:1], default=0) > MAX_WORDS


def sentences(text: str) -> list[str]:
    """Split prose at full stops, blank lines and the items of lists. Literal blocks are left out."""
    paragraphs = (part for part in _PARAGRAPH_END.split(text) if not part.startswith(_LITERAL))
    return [sentence for part in paragraphs for sentence in _SENTENCE_END.split(part.strip()) if sentence]


def docstrings(tree: ast.Module) -> list[Docstring]:
    """Return the docstrings of a module, its classes, functions and attributes in the order of the file."""
    found = [*_of_suite(tree.body[:1]), *_below(tree, attributes=True)]
    return sorted(found, key=lambda docstring: docstring.line)


_SUITES = ("body", "handlers", "orelse", "finalbody", "cases")
"""Fields of statements, handlers and cases that hold statements, in the order of the text."""


def _nested(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements, handlers and cases directly below a node. Expressions are left out unread."""
    for field in _SUITES:
        yield from getattr(node, field, ())


def _below(node: ast.AST, *, attributes: bool) -> Iterator[Docstring]:
    """Yield the docstrings in the statements of a node. `attributes`: they are in no function."""
    for child in _nested(node):
        match child:
            case ast.ClassDef():
                yield from _of_suite(child.body[:1])
                yield from _below(child, attributes=True)
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                yield from _of_suite(child.body[:1])
                yield from _below(child, attributes=False)
            case ast.stmt() | ast.ExceptHandler() | ast.match_case():
                yield from _below(child, attributes=attributes)
            case _:
                pass
    for field in ("body", "orelse", "finalbody") if attributes else ():
        suite: list[ast.stmt] = getattr(node, field, [])
        for assignment, following in pairwise(suite):
            if isinstance(assignment, ast.Assign | ast.AnnAssign):
                yield from _of_suite([following])


def _of_suite(statements: Sequence[ast.stmt]) -> Iterator[Docstring]:
    for statement in statements:
        match statement:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield Docstring(statement.lineno, inspect.cleandoc(text))
            case _:
                pass

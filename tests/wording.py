"""Tics of wording in docstrings, messages, descriptions and documents."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from .docstrings import docstrings
from .rooms import ROOT, modules

TICS = {
    "a clause as subject": re.compile(r"^\W*(?:What|Who|Whoever|Whatever|Whose)\b(?![^.]*\?)"),
    "goes on": re.compile(r"\b(?:go|goes|going|went|gone) on\b"),
    "stands": re.compile(r"\b(?:stand|stands|standing|stood)\b"),
    "is told": re.compile(r"\b(?:is|are|was|were|be|been|being) told\b"),
    "is none": re.compile(r"\b(?:is|are|was|were) none\b"),
    "as it is": re.compile(r"\bas (?:it|they|he) (?:is|are|was|were|stands?)\b"),
}
_SENTENCE_END = re.compile(r"(?<=[.!?:;])[)\"'”]*\s+|\n\s*\n|\n(?=[-*|#])")
_LEAST_WORDS = 3
"""Number of words from which a text of the code is prose."""


def sentences_with_tics(text: str) -> list[str]:
    """Return the sentences that need a second reading, each with the name of its tic."""
    parts = (part.strip() for part in _SENTENCE_END.split(text))
    return [f"{tic}: {part}" for part in parts for tic, form in TICS.items() if form.search(part)]


def texts() -> Iterator[tuple[str, str]]:
    """Yield each docstring, message and description of the product, and each document, with its place."""
    for file in modules():
        tree, place = ast.parse(file.read_text(encoding="utf-8")), str(file.relative_to(ROOT))
        for docstring in docstrings(tree):
            yield f"{place}:{docstring.line}", docstring.text
        in_statements = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
        for node in ast.walk(tree):
            match node:
                case ast.Constant(value=str(text)) if id(node) not in in_statements:
                    if len(text.split()) >= _LEAST_WORDS:
                        yield f"{place}:{node.lineno}", text
                case _:
                    pass
    for file in _documents():
        prose = re.sub(r"```.*?```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
        yield str(file.relative_to(ROOT)), prose


def _documents() -> list[Path]:
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

"""Pointing at one character of an expression, where the file has it as it reads."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ...files.expressions.expression import ExpressionError
from ...files.yaml.document import Document, Mark

_LINE = re.compile(r"\r?\n")


class Pointer:
    """Knows the lines of the files of one mission."""

    def __init__(self, documents: Iterable[Document]) -> None:
        self._texts = {str(document.path): document.text for document in documents}
        self._lines: dict[str, list[str]] = {}

    def told(self, start: Mark, text: str, error: ExpressionError, before: int = 0) -> tuple[Mark, str]:
        """Where and what is wrong with an expression that stands `before` characters after `start`.

        Where the file has it otherwise than it reads (escapes, lines) the sentence names the character.
        """
        line = self._line(start)
        quote = line[:1] if line[:1] in ("'", '"') else ""
        skipped = len(quote) + before
        if text and line[skipped:].startswith(text) and "\n" not in text:
            column = start.column + skipped + error.offset
            return Mark(start.file, start.line, column), str(error)
        return start, error.told(text)

    def _line(self, start: Mark) -> str:
        """The rest of the line from there."""
        if start.file not in self._lines:
            self._lines[start.file] = _LINE.split(self._texts.get(start.file, ""))
        lines = self._lines[start.file]
        return lines[start.line - 1][start.column - 1 :] if start.line <= len(lines) else ""

"""Comments of a mission file: whole lines above what they speak of."""

from __future__ import annotations

import re

_COMMENT = re.compile(r"\s*#+\s?(.*?)\s*")
_UNFIT = re.compile(r"[^\t -~\u00a0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")


class Comments:
    """The comments of one text; each is given once."""

    def __init__(self, text: str) -> None:
        self._lines = text.split("\n")
        self._given: set[int] = set()

    def at_the_top(self) -> tuple[str, ...]:
        """Those that begin the file."""
        found: list[str] = []
        for index, line in enumerate(self._lines):
            match = _COMMENT.fullmatch(line)
            if match is None:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, found))

    def above(self, line: int) -> tuple[str, ...]:
        """Those directly above a line, which counts from 1."""
        found: list[str] = []
        for index in range(line - 2, -1, -1):
            match = _COMMENT.fullmatch(self._lines[index]) if index < len(self._lines) else None
            if match is None or index in self._given:
                break
            self._given.add(index)
            found.append(match[1])
        return tuple(filter(None, reversed(found)))


def one_line(comment: str) -> str:
    """The comment as one line that any file can hold."""
    return _UNFIT.sub("", " ".join(comment.split()))

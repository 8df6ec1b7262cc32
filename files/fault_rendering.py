"""Faults as people and programs read them: text with the line at fault, JSON, annotations of GitHub."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from .errors import Diagnostic, FileError, Mark
from .fault_codes import title

Role: TypeAlias = Literal["place", "error", "warning", "hint", "margin", "caret"]
Paint: TypeAlias = Callable[[str, Role], str]
"""Gives a piece of text the colour of its role."""
MAX_COLUMNS = 120
"""Columns of the line at fault that are shown."""
MAX_SENTENCE_LENGTH = 600
"""Characters of a sentence: a name of a million letters is cut."""


def plain(text: str, role: Role) -> str:
    """Return the text without styling."""
    del role
    return text


class SourceLines:
    """Source lines of the files with faults. `texts` were read before; other files are read on demand."""

    def __init__(self, texts: Mapping[str, str] | None = None) -> None:
        self._lines = {file: _lines(text) for file, text in (texts or {}).items()}

    def line(self, mark: Mark) -> str | None:
        """Return the line of a place; None for a file that cannot be read or a line beyond its end."""
        if mark.file not in self._lines:
            self._lines[mark.file] = _read_lines(mark.file)
        lines = self._lines[mark.file]
        return lines[mark.line - 1] if mark.line <= len(lines) else None


def _read_lines(file: str) -> list[str]:
    from picktree.files.yaml import file_text

    try:
        return _lines(file_text.read_text(Path(file)))
    except FileError:
        return []


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def as_text(fault: Diagnostic, sources: SourceLines, paint: Paint = plain) -> str:
    """Return one fault as text: its sentence, and its line with a caret under the column."""
    head = paint(f"{one_line(str(fault.mark))}:", "place")
    kind = paint(f"{fault.severity} {fault.code}:", fault.severity)
    hint = paint(f" ({one_line(fault.hint)})", "hint") if fault.hint else ""
    sentence = f"{head} {kind} {_trail(fault)}{one_line(fault.message)}{hint}"
    excerpt = _excerpt(fault.mark, sources)
    lines = [sentence]
    if excerpt is not None:
        caret = " " * excerpt.caret + paint("^", "caret")
        lines.append(f"{paint(f'{fault.mark.line:>5} |', 'margin')} {excerpt.line}")
        lines.append(f"{paint('      |', 'margin')} {caret}")
    return "\n".join([*lines, *(f"      {one_line(line)}" for line in fault.detail.splitlines())])


def fault_lines(faults: Iterable[Diagnostic], paint: Paint = plain) -> str:
    """Return the text of faults in files on the disk."""
    sources = SourceLines()
    return "\n".join(as_text(fault, sources, paint) for fault in faults)


def as_github(fault: Diagnostic) -> str:
    """Return one fault as a workflow command, which GitHub shows beside the line."""
    mark = fault.mark
    hint = f" ({one_line(fault.hint)})" if fault.hint else ""
    values = {
        "file": one_line(mark.file),
        **({"line": str(mark.line), "col": str(mark.column)} if mark.line else {}),
        "title": f"{fault.code} {title(fault.code)}".strip(),
    }
    settings = ",".join(f"{key}={_property(value)}" for key, value in values.items())
    return f"::{fault.severity} {settings}::{_data(f'{_trail(fault)}{one_line(fault.message)}{hint}')}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def _trail(fault: Diagnostic) -> str:
    return f"{one_line(fault.where)}: " if fault.where else ""


def one_line(text: str) -> str:
    """Return the text in one line, without control characters for a terminal, and cut to a maximum length.

    >>> one_line("a\\x1b[31m b\\n")
    'a\\\\x1b[31m b\\\\n'
    """
    if len(text) > MAX_SENTENCE_LENGTH:
        text = text[: MAX_SENTENCE_LENGTH - 1] + "…"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@dataclass(frozen=True, slots=True)
class _Excerpt:
    line: str
    caret: int
    """Columns of the terminal before the caret."""


def _excerpt(mark: Mark, sources: SourceLines) -> _Excerpt | None:
    line = sources.line(mark)
    if line is None or not line.strip():
        return None
    at = min(mark.column - 1, len(line))
    first = 0 if len(line) <= MAX_COLUMNS else max(0, min(at - MAX_COLUMNS // 2, len(line) - MAX_COLUMNS))
    shown = "".join(c if c.isprintable() else " " for c in line[first : first + MAX_COLUMNS])
    before = "…" if first else ""
    after = "…" if first + MAX_COLUMNS < len(line) else ""
    columns = sum(_columns(c) for c in before + shown[: at - first])
    return _Excerpt((before + shown + after).rstrip(), columns)


def _columns(character: str) -> int:
    """Return the number of terminal columns of a character."""
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1

"""Diagnostics of an open text: the faults of `picktree check` with their places and quick fixes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from picktree.files import Diagnostic, file_checks
from picktree.files.yaml import syntax_faults

from .cursor import Place, Span
from .navigation import Edit

_NEW = re.compile(
    r"""did\ you\ mean\ '(?P<near>[^']+)'\?
    | write\ (?:'(?P<single>[^']+)'|(?P<double>"\{[\w.]+\}")|(?P<bare>[\w.+-]+(?:\ [\w/%]+)?)(?=$|;))
      (?:\ for\ '(?P<old>[^']+)')?""",
    re.VERBOSE,
)
_QUOTED = re.compile(r"'([^']+)'")
_TOKEN = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s,\[\]{}:]+|.")


def token_span(fault: Diagnostic, lines: list[str]) -> Span:
    """Return the word at the place of a fault."""
    row = max(fault.mark.line, 1) - 1
    line = lines[row] if row < len(lines) else ""
    start = min(max(fault.mark.column, 1) - 1, len(line))
    found = _TOKEN.match(line, start)
    return Span(Place(row, start), Place(row, found.end() if found else start))


def quick_fix(fault: Diagnostic, lines: list[str]) -> Edit | None:
    """Return the edit that a fault's hint names; None without an edit, or without its word in the text."""
    if fault.code in (syntax_faults.LOOK_ALIKE, syntax_faults.NO_BLANK) and 0 < fault.mark.line <= len(lines):
        return _repaired(fault, lines)
    hint = _NEW.search(fault.hint) or _NEW.search(fault.message)
    if hint is None:
        return None
    new = hint["near"] or hint["single"] or hint["double"] or hint["bare"]
    if (" " in new and not hint["bare"]) or "…" in new or fault.mark.line > len(lines) or not fault.mark.line:
        return None
    if hint["double"]:
        return _reference(fault, lines, new)
    words = [hint["old"]] if hint["old"] else _QUOTED.findall(fault.message)
    row = fault.mark.line - 1
    for word in words:
        at = _find(word, lines[row], fault.mark.column - 1)
        if at is not None and word != new:
            return Edit(Span(Place(row, at), Place(row, at + len(word))), new)
    return None


def _repaired(fault: Diagnostic, lines: list[str]) -> Edit | None:
    """Replace the characters of a typing error by the intended ones."""
    row = fault.mark.line - 1
    slip = syntax_faults.slip_at(lines, row, fault.mark.column - 1, fault.message)
    return slip and Edit(Span(Place(row, slip.start), Place(row, slip.end)), slip.meant)


def _reference(fault: Diagnostic, lines: list[str], new: str) -> Edit | None:
    """Replace a key without quotes or braces by a reference."""
    row, start = fault.mark.line - 1, fault.mark.column - 1
    key = re.escape(new[2:-2])
    found = re.compile(rf"\{{\s*{key}\s*\}}|\"?{key}\"?(?![\w.])").match(lines[row], start)
    return Edit(Span(Place(row, start), Place(row, found.end())), new) if found else None


def _find(word: str, line: str, start: int) -> int | None:
    """Return the position of a whole word in a line, at or behind `start`."""
    edge = r"(?<!\w)" if word[:1].isalnum() else ""
    end = r"(?!\w)" if word[-1:].isalnum() else ""
    found = re.compile(f"{edge}{re.escape(word)}{end}").search(line, start)
    return found.start() if found else None


@dataclass(frozen=True, slots=True)
class DocumentFault:
    """Fault as an editor shows it."""

    fault: Diagnostic
    span: Span
    """Word at fault; for a fault in another file, the line that names that file."""
    message: str
    """Sentence with hint and detail."""
    fix: Edit | None = None
    elsewhere: bool = False
    """Whether the fault is in another file."""


def document_faults(path: Path, text: str, checks: Mapping[str, file_checks.Check]) -> list[DocumentFault]:
    """Check a text, saved or not. `path`: its file, for files beside it."""
    if not file_checks.is_ours(text):
        return []
    report = file_checks.check_files(
        [file_checks.UnsavedText(path, text.encode("utf-8", errors="replace"))], checks
    )
    lines = text.split("\n")
    return [_located(fault, path, lines) for fault in report.faults]


def _located(fault: Diagnostic, path: Path, lines: list[str]) -> DocumentFault:
    message = fault.message + (f" ({fault.hint})" if fault.hint else "")
    message += f"\n{fault.detail}" if fault.detail else ""
    if fault.mark.file != str(path):
        span = _mention(fault.mark.file, lines)
        return DocumentFault(fault, span, f"{fault.mark}: {message}", elsewhere=True)
    return DocumentFault(fault, token_span(fault, lines), message, quick_fix(fault, lines))


def _mention(file: str, lines: list[str]) -> Span:
    """Return the line that names another file, else the first."""
    stem = Path(file).stem
    row = next((n for n, line in enumerate(lines) if stem in line.partition("#")[0]), 0)
    line = lines[row].rstrip()
    return Span(Place(row, len(line) - len(line.lstrip())), Place(row, len(line)))

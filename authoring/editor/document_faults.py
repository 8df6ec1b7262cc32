"""Faults of an open text: what `picktree check` says of it, each with its place and its quick fix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...files.diagnostics.file_checks import Check, UnsavedText, check_files, is_ours
from ...files.marks import Diagnostic
from .cursor import Place, Span
from .navigation import Edit
from .quick_fixes import quick_fix, token_span


@dataclass(frozen=True, slots=True)
class DocumentFault:
    """Fault as an editor shows it."""

    fault: Diagnostic
    span: Span
    """Word at fault; where the fault stands in another file, the line that names that file."""
    message: str
    """Sentence with hint and detail."""
    fix: Edit | None = None
    elsewhere: bool = False
    """Whether it stands in another file."""


def document_faults(path: Path, text: str, checks: Mapping[str, Check]) -> list[DocumentFault]:
    """Check a text that need not be saved. `path`: its file, for files beside it."""
    if not is_ours(text):
        return []
    report = check_files([UnsavedText(path, text.encode("utf-8", errors="replace"))], checks)
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

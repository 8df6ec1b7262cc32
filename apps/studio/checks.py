"""Work of a worker process on texts that are not saved: faults, and rehearsals with coverage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...authoring.editor.cursor import Place
from ...authoring.editor.document_faults import document_faults
from ...authoring.file_kinds import CHECKS
from ...authoring.rehearsal.rehearsal_result import Rehearsal, to_json
from ...authoring.rehearsal.rehearse import rehearse_files
from .answers import Places


def faults(path: Path, text: str) -> list[dict[str, Any]]:
    """Return what `picktree check` says of a text, with places in UTF-16 units."""
    places, lines = Places(text), LineStarts(text)
    found: list[dict[str, Any]] = []
    for each in document_faults(path, text, CHECKS):
        fix = each.fix
        found.append(
            {
                "from": places.units(lines.place(each.span.start)),
                "to": places.units(lines.place(each.span.end)),
                "line": each.fault.mark.line,
                "column": each.fault.mark.column,
                "where": each.fault.where,
                "message": each.message,
                "code": each.fault.code,
                "severity": each.fault.severity,
                "elsewhere": each.elsewhere,
                "fix": None
                if fix is None
                else {
                    "from": places.units(lines.place(fix.span.start)),
                    "to": places.units(lines.place(fix.span.end)),
                    "insert": fix.text,
                },
            }
        )
    return found


@dataclass(frozen=True, slots=True)
class LineStarts:
    """Places of the lines of a text, in code points."""

    text: str

    def place(self, at: Place) -> int:
        start = -1
        for _ in range(at.line):
            start = self.text.find("\n", start + 1)
            if start < 0:
                return len(self.text)
        return min(start + 1 + at.character, len(self.text))


def rehearsal(path: Path, text: str, cases: Path | None, names: tuple[str, ...]) -> dict[str, Any]:
    """Rehearse a text with its cases. Raises FileError with the faults of both."""
    result = rehearse_files(path, cases, names, text=text)
    values: dict[str, Any] = dict(to_json(result))
    return {**values, "nodes": _coverage(result)}


def _coverage(result: Rehearsal) -> dict[str, dict[str, Any]]:
    """Return by node how many of its points are reached, and sentences about the others."""
    found: dict[str, dict[str, Any]] = {}
    for point in result.coverage.points:
        entry = found.setdefault(point.node, {"reached": 0, "total": 0, "missed": []})
        entry["total"] += 1
        entry["reached"] += point.reached
        if not point.reached:
            entry["missed"].append(point.missed)
    return found

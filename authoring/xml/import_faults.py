"""Faults and notes of an import. A note is a warning: nothing is lost that a run would notice."""

from __future__ import annotations

from dataclasses import replace

from ...files.marks import Diagnostic, Mark


class ImportFaults:
    """Collector of an import's diagnostics. `strict`: notes are errors, each at its own place."""

    def __init__(self, *, strict: bool = False) -> None:
        self.strict = strict
        self._faults: list[Diagnostic] = []
        self._notes: dict[tuple[str, str, str], tuple[Diagnostic, int]] = {}

    def fault(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        self._faults.append(Diagnostic(mark, trail, message, hint, code))

    def note(self, mark: Mark, trail: str, message: str, hint: str = "", *, code: str) -> None:
        """Add a note; the same one in one file is reported once, with its count."""
        if self.strict:
            self.fault(mark, trail, message, hint, code=code)
            return
        first, count = self._notes.get((mark.file, code, message), (None, 0))
        known = first or Diagnostic(mark, trail, message, hint, code, "warning")
        self._notes[mark.file, code, message] = known, count + 1

    def add(self, diagnostic: Diagnostic) -> None:
        """Add a diagnostic as it is."""
        self._faults.append(diagnostic)

    @property
    def errors(self) -> bool:
        """Whether there is any error."""
        return any(fault.severity == "error" for fault in self._faults)

    def all(self) -> tuple[Diagnostic, ...]:
        counted = (
            replace(note, message=f"{note.message}, at {count} places") if count > 1 else note
            for note, count in self._notes.values()
        )
        return (*self._faults, *counted)

"""Diagnostics of a mission file: errors and warnings with their places, up to a limit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from picktree.files import Diagnostic, Location, suggest_name
from picktree.files.yaml import Document

from .mission import MAX_NODES

MAX_FAULTS: Final = 200
"""Maximum number of errors that are kept; further ones are counted."""


class MissionDiagnostics:
    """Errors of one mission, over all its files."""

    def __init__(self) -> None:
        self._kept: list[Diagnostic] = []
        self._more = 0
        self._nodes = 0
        self._left_out: list[str] = []

    def has_room(self, document: Document, loc: Location) -> bool:
        """Count a node of the text; return False when there are too many for the mission to be built."""
        self._nodes += 1
        if self._nodes == MAX_NODES + 1:
            message = f"here is node number {self._nodes} of the mission"
            self.at(document, loc, "", message, f"at most {MAX_NODES} nodes", code="P236")
        return self._nodes <= MAX_NODES

    @property
    def full(self) -> bool:
        """Whether another error would only be counted."""
        return len(self._kept) >= MAX_FAULTS

    def __len__(self) -> int:
        return len(self._kept) + self._more

    def add(self, fault: Diagnostic) -> None:
        if self.full:
            self._more += 1
        else:
            self._kept.append(fault)

    def at(
        self,
        document: Document,
        loc: Location,
        trail: str,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        detail: str = "",
    ) -> None:
        """Add an error about the value at `loc`, or (`key`) about its key."""
        if self.full:
            self._more += 1
            return
        mark = document.key_mark(loc) if key else document.mark(loc)
        self._kept.append(Diagnostic(mark, trail, message, hint, code, detail=detail))

    def leave_out(self, trail: str) -> None:
        """Note a node that is not read because of an error that is reported elsewhere."""
        self._left_out.append(trail)

    def nearest(self, name: str, known: Iterable[str]) -> str:
        """Return the nearest name as `suggest_name`, which is costly; empty when the list is full."""
        return "" if self.full else suggest_name(name, known)

    def within(self, tree: str) -> bool:
        """Whether any error lies in that tree, or a node that was left out."""
        starts = (f"{tree}/", f"trees.{tree}.")
        names = (tree, f"trees.{tree}")
        places = (*(fault.where for fault in self._kept), *self._left_out)
        return any(place in names or place.startswith(starts) for place in places)

    def all(self) -> tuple[Diagnostic, ...]:
        """Return the errors in the order of the files; the last one gives the number that was left out."""
        kept = sorted(dict.fromkeys(self._kept), key=lambda fault: fault.mark)
        if self._more:
            message = f"and {self._more} more faults"
            kept.append(Diagnostic(kept[-1].mark, "", message, "mend those above first", "P200"))
        return tuple(kept)

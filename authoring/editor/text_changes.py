"""Smallest replacements that make one text of another."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import SequenceMatcher


@dataclass(frozen=True, slots=True)
class TextChange:
    """Replacement of the part of a text from `start` to `end`, in code points from 0."""

    start: int
    end: int
    text: str


def changes(old: str, new: str) -> list[TextChange]:
    """Return replacements of whole lines, narrowed to the letters that differ, that make `new` of `old`."""
    before, after = old.splitlines(keepends=True), new.splitlines(keepends=True)
    head = 0
    while head < min(len(before), len(after)) and before[head] == after[head]:
        head += 1
    tail = 0
    while tail < min(len(before), len(after)) - head and before[-1 - tail] == after[-1 - tail]:
        tail += 1
    middle_old, middle_new = before[head : len(before) - tail], after[head : len(after) - tail]
    starts = [0]
    for line in before:
        starts.append(starts[-1] + len(line))
    found: list[TextChange] = []
    matcher = SequenceMatcher(None, middle_old, middle_new, autojunk=False)
    for tag, a, b, c, d in matcher.get_opcodes():
        if tag != "equal":
            start, end = starts[head + a], starts[head + b]
            found.append(_narrowed(old, start, end, "".join(middle_new[c:d])))
    return found


def _narrowed(old: str, start: int, end: int, written: str) -> TextChange:
    """Leave out equal letters at both ends."""
    replaced = old[start:end]
    head = _common(replaced, written)
    replaced, written = replaced[head:], written[head:]
    tail = _common(replaced[::-1], written[::-1])
    return TextChange(start + head, end - tail, written[: len(written) - tail])


def _common(one: str, other: str) -> int:
    """Return the number of equal letters at the beginning of two texts."""
    return next(
        (at for at, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other))
    )

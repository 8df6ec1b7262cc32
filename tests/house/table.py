"""Figures as a table for a terminal."""

from __future__ import annotations

from itertools import chain

from .figures import Figures, Value

MISSING = "–"


def table(now: Figures, before: Figures | None = None) -> str:
    """Return a line for each figure, under the headings of their groups. `before`: an earlier state."""
    states = [now] if before is None else [now, before]
    groups = dict.fromkeys(chain.from_iterable(states))
    names = {
        group: list(dict.fromkeys(chain.from_iterable(state.get(group, {}) for state in states)))
        for group in groups
    }
    width = max(len(name) for each in names.values() for name in each) + 2
    lines = ["" if before is None else f"{'':{width}}{'now':>10}{'before':>10}"]
    for group in groups:
        lines.append(group)
        for name in names[group]:
            numbers = (number(state.get(group, {}).get(name)) for state in states)
            lines.append(f"  {name:{width - 2}}" + "".join(f"{text:>10}" for text in numbers))
        lines.append("")
    return "\n".join(lines).lstrip("\n")


def number(value: Value) -> str:
    return MISSING if value is None else f"{value:,.1f}".removesuffix(".0")

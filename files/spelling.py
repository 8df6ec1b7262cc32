"""What a mistyped name may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

_MOST = 1000
"""Names that are looked at; each costs some microseconds."""


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint: "did you mean 'Grasp'?", or "known: a, b, c", or nothing when nothing is known."""
    names = list(dict.fromkeys(islice(known, _MOST)))
    lowered = {n.lower(): n for n in reversed(names)}
    # difflib is quadratic in the length: a name of 10,000 letters is no typo.
    close = difflib.get_close_matches(name[:60].lower(), lowered, n=1, cutoff=0.6)
    if close:
        return f"did you mean {lowered[close[0]]!r}?"
    if not names:
        return ""
    shown = names if len(names) <= 25 else [*names[:25], "…"]
    return f"known: {', '.join(shown)}"

"""The symbols as strokes on a square of 14 pixels, so that no font needs to have them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, Literal, TypeAlias

from ..chart import Symbol

Icon: TypeAlias = Symbol | Literal["out"]

_RING = "M7 1.8a5.2 5.2 0 1 1 0 10.4a5.2 5.2 0 1 1 0-10.4z"
_STROKES: Final[Mapping[Icon, str]] = {
    "action": "M4 2.8l7 4.2l-7 4.2z",
    "branch": "M1.5 7h3.2l3.6-4h4.2M4.7 7l3.6 4h4.2",
    "clock": f"{_RING}M7 4.2v2.8l2 1.4",
    "condition": f"{_RING}M4.7 7.1l1.6 1.7l3.1-3.6",
    "control": "M3 3h8v8h-8z",
    "decorator": "M7 1.8l5.2 5.2l-5.2 5.2l-5.2-5.2z",
    "fallback": "M4.4 4.9a2.6 2.6 0 1 1 3.9 2.2c-.9.6-1.3 1-1.3 2M7 11.6v.6",
    "force": "M7 2.2v6.4M7 11.2v.6",
    "loop": "M11.8 7a4.8 4.8 0 1 1-1.6-3.6M10.6 1v2.8h-2.8",
    "not": "M2.5 5h9v4.5",
    "out": "M1.5 7h10M8.2 3.8l3.3 3.2l-3.3 3.2",
    "parallel": "M1.5 4.2h9.5M8.8 2l2.4 2.2l-2.4 2.2M1.5 9.8h9.5M8.8 7.6l2.4 2.2l-2.4 2.2",
    "recover": f"{_RING}M7 4.2v5.6M4.2 7h5.6",
    "sequence": "M1.5 7h10.5M8.6 3.6l3.6 3.4l-3.6 3.4",
    "subtree": "M5.2 1.5h3.6v3h-3.6zM1.2 9.5h3.6v3h-3.6zM9.2 9.5h3.6v3h-3.6zM7 4.5v2.4M3 9.5v-2.6h8v2.6",
}


def definitions(icons: Iterable[Icon]) -> str:
    """The symbols for `use`, in one order whatever the order of the icons."""
    return "".join(
        f'<symbol id="i-{icon}" viewBox="0 0 14 14"><path d="{_STROKES[icon]}"/></symbol>'
        for icon in sorted(set(icons))
    )


def use(icon: Icon, x: float, y: float) -> str:
    return f'<use href="#i-{icon}" class="icon" x="{x:g}" y="{y:g}" width="14" height="14"/>'


ALL: Final[tuple[Icon, ...]] = tuple(_STROKES)

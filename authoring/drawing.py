"""Drawing of a chart in the format of a file's name: text for a terminal, an HTML page, DOT, or SVG."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, Protocol, TypeAlias

from picktree.files import PicktreeError

from .dot_drawing import dot
from .html_drawing import html
from .mission_chart import (
    Chart,
)
from .svg_drawing import (
    svg,
)
from .text_drawing import text

Suffix: TypeAlias = Literal[".svg", ".html", ".dot", ".txt"]


class _Drawer(Protocol):
    def __call__(self, chart: Chart, /, *, expand: bool = False) -> str: ...


_DRAWERS: Final[Mapping[Suffix, _Drawer]] = {".svg": svg, ".html": html, ".dot": dot, ".txt": text}


def suffix_of(name: str) -> Suffix:
    """Return the drawing format of a file name. Raises PicktreeError for an unknown suffix."""
    for suffix in _DRAWERS:
        if name.lower().endswith(suffix):
            return suffix
    raise PicktreeError(f"{name}: a picture is a file that ends in .svg, .html, .dot or .txt")


def drawing_text(chart: Chart, suffix: Suffix, *, expand: bool = False) -> str:
    """Return the text of a drawing file; equal charts give equal texts on every machine."""
    return _DRAWERS[suffix](chart, expand=expand)

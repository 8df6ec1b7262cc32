"""The kinds of pictures, by the suffix of the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, Protocol, TypeAlias

from ....errors import PicktreeError
from ..chart import Chart
from .dot import dot
from .html import html
from .svg import svg
from .text import text

Suffix: TypeAlias = Literal[".svg", ".html", ".dot", ".txt"]


class _Drawer(Protocol):
    def __call__(self, chart: Chart, /, *, expand: bool = False) -> str: ...


_DRAWERS: Final[Mapping[Suffix, _Drawer]] = {".svg": svg, ".html": html, ".dot": dot, ".txt": text}


def suffix_of(name: str) -> Suffix:
    """What kind of picture a file of that name holds. Raises PicktreeError."""
    for suffix in _DRAWERS:
        if name.lower().endswith(suffix):
            return suffix
    raise PicktreeError(f"{name}: a picture is a file that ends in .svg, .html, .dot or .txt")


def drawn(chart: Chart, suffix: Suffix, *, expand: bool = False) -> str:
    """The text of such a file; the same chart gives the same text on every machine."""
    return _DRAWERS[suffix](chart, expand=expand)

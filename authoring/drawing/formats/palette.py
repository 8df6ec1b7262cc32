"""Colours of pictures on light and on dark screens, and the style sheet that is made with them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Final

PAGE: Final = Path(__file__).parent / "page"

LIGHT: Final[Mapping[str, str]] = {
    "paper": "#f6f7f9", "sheet": "#ffffff", "bar": "#eef1f5", "rim": "#c5ccd6", "ink": "#1d2433",
    "muted": "#5f6b7c", "edge": "#8f9bad",
    "action": "#ffffff", "action_rim": "#7a8699",
    "condition": "#e7f0fd", "condition_rim": "#5388d6",
    "control": "#e9edf3", "control_rim": "#66748a",
    "decorator": "#f2ecfc", "decorator_rim": "#9474d4",
    "subtree": "#e3f3ea", "subtree_rim": "#3f9467",
    "cure": "#fff0df", "cure_rim": "#d27a1e", "cure_ink": "#8a4a05",
    "choice": "#e7f0fd", "choice_rim": "#5388d6", "choice_ink": "#1f4f94",
    "reference": "#0a5cbf", "output": "#8226b0", "rule": "#8a5a00", "stop": "#d92d20",
    "success": "#12915a", "success_fill": "#d9f4e5", "failure": "#d92d20", "failure_fill": "#fde3e1",
    "running": "#1668e3", "running_fill": "#dbe9ff", "skipped": "#8f9bad", "found": "#ffd54a",
}  # fmt: skip
DARK: Final[Mapping[str, str]] = {
    "paper": "#13161b", "sheet": "#1a1e25", "bar": "#222833", "rim": "#3b4454", "ink": "#e5e9f0",
    "muted": "#9aa6b6", "edge": "#66738a",
    "action": "#20262f", "action_rim": "#78859a",
    "condition": "#1c2a40", "condition_rim": "#5c90dc",
    "control": "#2a313d", "control_rim": "#8592a8",
    "decorator": "#2a2438", "decorator_rim": "#a58ae0",
    "subtree": "#1b3027", "subtree_rim": "#52ab7d",
    "cure": "#3a2a17", "cure_rim": "#e0913e", "cure_ink": "#f5bd80",
    "choice": "#1c2a40", "choice_rim": "#5c90dc", "choice_ink": "#a9c8f5",
    "reference": "#79b4ff", "output": "#d39af5", "rule": "#e3b35a", "stop": "#ff6b5e",
    "success": "#3ecf8e", "success_fill": "#143626", "failure": "#ff6b5e", "failure_fill": "#421d1b",
    "running": "#62a0ff", "running_fill": "#172f55", "skipped": "#66738a", "found": "#b98a00",
}  # fmt: skip


def style() -> str:
    """The rules for nodes, edges and frames. No variables: not all viewers of SVG know those."""
    template = Template((PAGE / "drawing.css").read_text(encoding="utf-8"))
    return _themed(template)


def page_style() -> str:
    """The rules for the page around a drawing."""
    return _themed(Template((PAGE / "page.css").read_text(encoding="utf-8")))


def _themed(template: Template) -> str:
    dark = template.substitute(DARK)
    coloured = "\n".join(
        line for line, plain in zip(dark.splitlines(), template.template.splitlines(), strict=True)
        if "$" in plain
    )  # fmt: skip
    return f"{template.substitute(LIGHT)}@media (prefers-color-scheme: dark) {{\n{coloured}\n}}\n"

"""The page itself: one HTML file with its style, its scripts and its data in it."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Final

from ... import __version__
from ...authoring.drawing.formats import palette
from .page_data.packing import Section, pack

PAGE: Final = Path(__file__).parent / "page"
DRAWING: Final = ("libraries.js", "arranging.js", "viewer.js")
"""Of the drawn tree; `report.js` finds `PicktreeDrawing` there."""


def page(title: str, summary: str, sections: Iterable[Section]) -> str:
    """The whole file. `summary` is what is said where scripts do not run."""
    scripts = [(palette.PAGE / name).read_text(encoding="utf-8") for name in DRAWING]
    scripts.append((PAGE / "report.js").read_text(encoding="utf-8"))
    template = Template((PAGE / "page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title),
        summary=escape(summary),
        generator=f"picktree {__version__}",
        policy=escape(_policy(scripts)),
        style=style(),
        payload=pack(sections),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
    )


def style() -> str:
    """The style sheet: the palette of the drawn tree as variables, then its rules and the page's own."""
    drawing = Template((palette.PAGE / "drawing.css").read_text(encoding="utf-8"))
    return "\n".join(
        (
            f":root {{ color-scheme: light; {_variables(palette.LIGHT)} }}",
            f':root[data-theme="dark"] {{ color-scheme: dark; {_variables(palette.DARK)} }}',
            drawing.substitute({name: f"var(--{name})" for name in palette.LIGHT}),
            (PAGE / "report.css").read_text(encoding="utf-8"),
        )
    )


def _variables(colours: Mapping[str, str]) -> str:
    return " ".join(f"--{name}: {value};" for name, value in colours.items())


def _policy(scripts: Iterable[str]) -> str:
    """Nothing may be fetched, and no script may run but these."""
    digests = (hashlib.sha256(script.encode("utf-8")).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode('ascii')}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src blob:; base-uri 'none'; form-action 'none'"
    )

"""The pages that explain the codes of faults, one a code: `P104.md` in the folder `pages`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ...errors import PicktreeError
from ..value_wording import suggest_name

FOLDER = Path(__file__).parent / "pages"


@dataclass(frozen=True, slots=True)
class CodeExample:
    """A file, or a part of one, as a page shows it; `language` is the fence's: yaml, xml or text."""

    language: str
    text: str


@dataclass(frozen=True, slots=True)
class CodePage:
    """Page of a code: `wrong` is a file that yields it, `right` the same file corrected."""

    code: str
    title: str
    explanation: str
    wrong: CodeExample
    right: CodeExample
    text: str
    """The page as it is written, in Markdown."""


_PAGE = re.compile(
    r"# (?P<code>P\d{3}) (?P<title>[^\n]+)\n\n(?P<explanation>.+?)\n\n"
    r"## Wrong\n\n```(?P<language>yaml|xml|text)\n(?P<wrong>.*?)\n```\n\n"
    r"## Right\n\n```(?P=language)\n(?P<right>.*?)\n```\n",
    re.DOTALL,
)


@cache
def pages() -> tuple[CodePage, ...]:
    """All pages in the order of their codes."""
    return tuple(_read(path) for path in sorted(FOLDER.glob("P*.md")))


def page(code: str) -> CodePage:
    """The page of a code, in capitals or not. Raises PicktreeError with the nearest one."""
    known = {page.code: page for page in pages()}
    found = known.get(code.upper())
    if found is None:
        hint = suggest_name(code, known)
        hint = hint if hint.startswith("did you mean") else "`picktree explain-code` lists all"
        raise PicktreeError(f"there is no code {code[:40]!r} ({hint})")
    return found


def title(code: str) -> str:
    """The title of a code's page; empty for a code without one."""
    return next((page.title for page in pages() if page.code == code), "")


def _read(path: Path) -> CodePage:
    text = path.read_text(encoding="utf-8")
    match = _PAGE.fullmatch(text)
    if match is None or match["code"] != path.stem:
        raise ValueError(f"{path} does not have the form of a page")
    wrong, right = (
        CodeExample(match["language"], match["wrong"]),
        CodeExample(match["language"], match["right"]),
    )
    return CodePage(match["code"], match["title"], match["explanation"], wrong, right, text)


def index() -> str:
    """A Markdown page that lists all codes, for the documentation."""
    lines = [
        "# Codes of faults",
        "",
        "Every fault that `picktree check` reports has a code, and every code a page: "
        "`picktree explain-code P104` prints it.",
        "",
        "Made by `picktree explain-code --index`; do not edit.",
    ]
    for family, name in FAMILIES.items():
        mine = [page for page in pages() if page.code.startswith(family)]
        if mine:
            lines += ["", f"## {family}xx: {name}", "", "| code | meaning |", "|---|---|"]
            lines += [f"| [{p.code}](../files/diagnostics/pages/{p.code}.md) | {p.title} |" for p in mine]
    return "\n".join(lines) + "\n"


FAMILIES = {
    "P1": "the form of any file",
    "P2": "missions",
    "P3": "the linter of missions",
    "P4": "scenes",
    "P5": "robots",
    "P6": "faults files",
    "P7": "cases",
    "P8": "plans",
    "P9": "XML",
}
"""Family of codes by the letter and first digit."""

"""Codes of faults: a page for each, `P104.md` in the folder `pages`, and comments that suppress warnings.

A comment suppresses warnings on its line: `# picktree: allow P304, P305`, then perhaps why.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml

from picktree.files.yaml import file_text

from .errors import MAX_FAULTS, Diagnostic, Mark, PicktreeError
from .value_wording import suggest_name

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
    """Unchanged Markdown text of the page."""


_PAGE = re.compile(
    r"# (?P<code>P\d{3}) (?P<title>[^\n]+)\n\n(?P<explanation>.+?)\n\n"
    r"## Wrong\n\n```(?P<language>yaml|xml|text)\n(?P<wrong>.*?)\n```\n\n"
    r"## Right\n\n```(?P=language)\n(?P<right>.*?)\n```\n",
    re.DOTALL,
)


@cache
def pages() -> tuple[CodePage, ...]:
    """Return all pages in the order of their codes."""
    return tuple(_read_page(path) for path in sorted(FOLDER.glob("P*.md")))


def page_file(code: str) -> Path:
    """Return the file of a code's page, which need not exist."""
    return FOLDER / f"{code}.md"


def page(code: str) -> CodePage:
    """Return the page of a code, in capitals or not. Raises PicktreeError with the nearest one."""
    known = {page.code: page for page in pages()}
    found = known.get(code.upper())
    if found is None:
        hint = suggest_name(code, known)
        hint = hint if hint.startswith("did you mean") else "`picktree explain-code` lists all"
        raise PicktreeError(f"there is no code {code[:40]!r} ({hint})")
    return found


def title(code: str) -> str:
    """Return the title of a code's page; empty for a code without one."""
    return next((page.title for page in pages() if page.code == code), "")


def _read_page(path: Path) -> CodePage:
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
    """Return a Markdown page with all codes, for the documentation."""
    lines = [
        "# Codes of faults",
        "",
        "Every fault that `picktree check` reports has a code, and every code a page with a wrong and a "
        "right example. One command prints it:",
        "",
        "```sh",
        "picktree explain-code P104",
        "```",
        "",
        "Made by `picktree explain-code --index`; do not edit.",
    ]
    for family, name in FAMILIES.items():
        mine = [page for page in pages() if page.code.startswith(family)]
        if mine:
            lines += ["", f"## {family}xx: {name}", "", "| code | meaning |", "|---|---|"]
            lines += [f"| [{p.code}](../files/pages/{p.code}.md) | {p.title} |" for p in mine]
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
_COMMENT = re.compile(r"(?:^|(?<=[ \t]))#[ \t]*picktree[ \t]*:[ \t]*(?P<text>[^\r\n]*)", re.MULTILINE)
_ALLOW = re.compile(r"allow[ \t]+(?P<codes>[^\s,]+(?:[ \t]*,[ \t]*[^\s,]+)*)(?:[ \t].*)?")


@dataclass(frozen=True, slots=True)
class Suppression:
    """One code that a comment names, and where."""

    code: str
    mark: Mark


def apply_suppressions(
    faults: Iterable[Diagnostic], text: str, file: str, known: Iterable[str], *, complete: bool
) -> tuple[Diagnostic, ...]:
    """Return the faults of a file without the warnings that its comments suppress, and the faults of these
    comments.

    `known` are all codes. `complete`: the file was checked to its end, so that a suppression without a
    warning is a mistake.
    """
    allowances, wrong = _suppressions(text, file, tuple(known))
    allowed = {(a.code, a.mark.line) for a in allowances}
    kept = [f for f in faults if f.severity == "error" or (f.code, f.mark.line) not in allowed]
    severities = {(f.code, f.mark.line): f.severity for f in faults}
    for allowance in allowances:
        severity = severities.get((allowance.code, allowance.mark.line))
        if severity == "error":
            message, hint = f"{allowance.code} is an error: no comment allows it", "mend it"
            wrong.append(Diagnostic(allowance.mark, "", message, hint, "P131", "warning"))
        elif severity is None and complete:
            message = f"there is no warning {allowance.code} on this line"
            wrong.append(Diagnostic(allowance.mark, "", message, "leave the comment out", "P130", "warning"))
    return (*kept, *wrong[:MAX_FAULTS])


def _suppressions(text: str, file: str, known: tuple[str, ...]) -> tuple[list[Suppression], list[Diagnostic]]:
    allowances: list[Suppression] = []
    wrong: list[Diagnostic] = []
    places = file_text.PositionIndex(file, text)
    for comment in _comments(text):
        mark = places.mark(comment.start())
        match = _ALLOW.fullmatch(comment["text"].strip())
        if match is None:
            message = "this comment to picktree is not understood"
            wrong.append(Diagnostic(mark, "", message, "as '# picktree: allow P304'", "P131", "warning"))
            continue
        for code in re.split(r"[ \t]*,[ \t]*", match["codes"]):
            if len(wrong) >= MAX_FAULTS:
                break
            if code in known:
                allowances.append(Suppression(code, mark))
            else:
                hint = suggest_name(code, known)
                hint = hint if hint.startswith("did you mean") else "as '# picktree: allow P304'"
                wrong.append(Diagnostic(mark, "", f"there is no code {code[:40]!r}", hint, "P131", "warning"))
    return allowances, wrong


def _comments(text: str) -> Iterator[re.Match[str]]:
    """Yield the suppression comments, without look-alikes inside of texts; an unreadable file has none."""
    found = list(_COMMENT.finditer(text))
    if not found:
        return
    try:
        starts, ends = _scalars(text)
    except yaml.YAMLError:
        return
    for comment in found:
        before = bisect_right(starts, comment.start()) - 1
        if before < 0 or comment.start() >= ends[before]:
            yield comment


def _scalars(text: str) -> tuple[list[int], list[int]]:
    """Return start and end indices of the scalars of a readable file."""
    starts: list[int] = []
    ends: list[int] = []
    for event in yaml.parse(text, yaml.CSafeLoader):
        if isinstance(event, yaml.ScalarEvent) and event.start_mark and event.end_mark:
            start = event.start_mark.index
            if event.style in ("|", ">"):  # a comment may follow the |
                start = text.find("\n", start)
            starts.append(start)
            ends.append(event.end_mark.index)
    return starts, ends

"""Comments that silence warnings on their line: `# picktree: allow P304, P305`, then perhaps why."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import yaml

from ..marks import MAX_FAULTS, Diagnostic, Mark
from ..value_wording import suggest_name
from ..yaml.file_text import PositionIndex

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
    """The faults of a file without the warnings that its comments allow, and what is wrong with these.

    `known` are all codes. `complete`: nothing kept the file from being looked at to its end, so that an
    allowance without a warning is a mistake.
    """
    allowances, wrong = _read(text, file, tuple(known))
    allowed = {(a.code, a.mark.line) for a in allowances}
    kept = [f for f in faults if f.severity == "error" or (f.code, f.mark.line) not in allowed]
    said = {(f.code, f.mark.line): f.severity for f in faults}
    for allowance in allowances:
        severity = said.get((allowance.code, allowance.mark.line))
        if severity == "error":
            message, hint = f"{allowance.code} is an error: no comment allows it", "mend it"
            wrong.append(Diagnostic(allowance.mark, "", message, hint, "P131", "warning"))
        elif severity is None and complete:
            message = f"there is no warning {allowance.code} on this line"
            wrong.append(Diagnostic(allowance.mark, "", message, "leave the comment out", "P130", "warning"))
    return (*kept, *wrong[:MAX_FAULTS])


def _read(text: str, file: str, known: tuple[str, ...]) -> tuple[list[Suppression], list[Diagnostic]]:
    allowances: list[Suppression] = []
    wrong: list[Diagnostic] = []
    places = PositionIndex(file, text)
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
    """The comments to picktree, none of what only looks like one in a text; an unreadable file has none."""
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
    """Where the texts of a readable file begin and end."""
    starts: list[int] = []
    ends: list[int] = []
    for event in yaml.parse(text, yaml.CSafeLoader):
        if isinstance(event, yaml.ScalarEvent) and event.start_mark and event.end_mark:
            start = event.start_mark.index
            if event.style in ("|", ">"):  # behind the | a comment may stand
                start = text.find("\n", start)
            starts.append(start)
            ends.append(event.end_mark.index)
    return starts, ends

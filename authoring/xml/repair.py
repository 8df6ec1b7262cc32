"""Repair of texts that are not XML in the ways that BehaviorTree.CPP's parser (tinyxml2) overlooks.

It also keeps line breaks and tabs in values, which an XML parser turns into blanks and tinyxml2 does not.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

_NEXT = re.compile(r"[<&]")
_TAG = re.compile(r"""<[A-Za-z_:][^\s/>="'<]*(?:\s+[^\s=<>/"']+\s*=\s*(?:"[^"]*"|'[^']*'))+\s*/?>""")
_VALUE = re.compile(r""""[^"]*"|'[^']*'""")
_LONE_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d{1,8}|#x[0-9a-fA-F]{1,8});)")
_IN_VALUE = re.compile(rf"{_LONE_AMPERSAND.pattern}|<|\t|\r\n|\r|\n")
_ESCAPES = {"&": "&amp;", "<": "&lt;", "\t": "&#9;", "\r\n": "&#10;", "\r": "&#10;", "\n": "&#10;"}
_ENDS = {"<!--": "-->", "<![CDATA[": "]]>", "<?": "?>"}
_MESSAGES = {
    "&": ("'&' stands alone; it is read as BehaviorTree.CPP reads it", "write &amp;"),
    "<": ("'<' stands in a value; it is read as BehaviorTree.CPP reads it", "write &lt;"),
    "--": ("'--' stands in a comment, which XML forbids", "write one '-', or '='"),
}


@dataclass(frozen=True, slots=True)
class Repair:
    """Kind of repair: the first place, as an index into the text's bytes, and the number of places."""

    at: int
    message: str
    hint: str
    count: int


@dataclass(slots=True)
class RepairedXml:
    """Text for an XML parser, and the way back from its bytes to those of the original."""

    text: str = ""
    repairs: tuple[Repair, ...] = ()
    _starts: list[int] = field(default_factory=lambda: [0])
    """First byte of each unchanged part in the repaired text."""
    _origins: list[int] = field(default_factory=lambda: [0])
    """The same in the original text."""

    def original(self, at: int) -> int:
        """Return the byte of the original text for one of the repaired text."""
        part = bisect_right(self._starts, at) - 1
        return self._origins[part] + at - self._starts[part]

    def add(self, start: int, origin: int) -> None:
        """Note where an unchanged part begins."""
        self._starts.append(start)
        self._origins.append(origin)


@dataclass(frozen=True, slots=True)
class _Edit:
    start: int
    end: int
    text: str
    kind: str = ""
    """Key of its message; empty: nothing is reported."""


def repair(text: str, *, strict: bool = False) -> RepairedXml:
    """Return the text with escapes where tinyxml2 does without. `strict`: only line breaks and tabs."""
    found = RepairedXml()
    pieces: list[str] = []
    first: dict[str, int] = {}
    counts: dict[str, int] = {}
    at, done, origin = 0, 0, 0
    for edit in _edits(text):
        if strict and edit.kind:
            continue
        kept = text[at : edit.start]
        size = len(kept.encode("utf-8", "surrogatepass"))
        if edit.kind:
            first.setdefault(edit.kind, origin + size)
            counts[edit.kind] = counts.get(edit.kind, 0) + 1
        pieces += [kept, edit.text]
        done += size + len(edit.text)
        origin += size + edit.end - edit.start
        found.add(done, origin)
        at = edit.end
    found.text = "".join([*pieces, text[at:]])
    found.repairs = tuple(Repair(first[kind], *_MESSAGES[kind], counts[kind]) for kind in first)
    return found


def _edits(text: str) -> Iterator[_Edit]:
    """Yield the edits in the order of the text. All that is replaced is ASCII."""
    at = 0
    while match := _NEXT.search(text, at):
        at = match.start()
        if match[0] == "&":
            if _LONE_AMPERSAND.match(text, at):
                yield _Edit(at, at + 1, _ESCAPES["&"], "&")
            at += 1
            continue
        opening = next((each for each in _ENDS if text.startswith(each, at)), "")
        if opening:
            end = text.find(_ENDS[opening], at + len(opening))
            if end < 0:
                return
            if opening == "<!--":
                yield from _dashes(text, at + len(opening), end)
            at = end + len(_ENDS[opening])
            continue
        tag = _TAG.match(text, at)
        if tag is None:
            at += 1
            continue
        for value in _VALUE.finditer(tag[0]):
            for unfit in _IN_VALUE.finditer(value[0]):
                start = at + value.start() + unfit.start()
                kind = unfit[0] if unfit[0] in _MESSAGES else ""
                yield _Edit(start, start + len(unfit[0]), _ESCAPES[unfit[0]], kind)
        at = tag.end()


def _dashes(text: str, start: int, end: int) -> Iterator[_Edit]:
    """Yield edits of the same length for each `--` in a comment, and for a `-` at its end."""
    for match in re.finditer(r"-(?=-)|-$", text[start:end]):
        yield _Edit(start + match.start(), start + match.end(), "~", "--")

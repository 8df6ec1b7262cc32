"""Writer of elements as the text of an XML file."""

from __future__ import annotations

import re
from collections.abc import Iterator

from .element import Element

MAX_LINE_LENGTH = 110
"""Maximum length of a line; longer elements have each attribute on a separate line."""
_UNFIT = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ESCAPES = {"&": "&amp;", "<": "&lt;", ">": "&gt;"}
_IN_ATTRIBUTES = {**_ESCAPES, '"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}


def unfit(text: str) -> str:
    """Return the first character that no XML file can hold; empty when there is none."""
    found = _UNFIT.search(text)
    return found[0] if found else ""


def to_text(root: Element) -> str:
    """Return the text of the whole file. The element must be free of characters that are `unfit`."""
    below = (f"<!-- {_in_comment(comment)} -->" for comment in root.comments_below)
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *_lines(root, ""), *below, ""])


def _lines(element: Element, indent: str) -> Iterator[str]:
    for comment in element.comments:
        yield f"{indent}<!-- {_in_comment(comment)} -->"
    words = [f'{key}="{_escaped(value, _IN_ATTRIBUTES)}"' for key, value in element.attributes.items()]
    start = " ".join([f"{indent}<{element.name}", *words])
    if len(start) > MAX_LINE_LENGTH and len(words) > 1:
        start = f"\n{indent}    ".join([f"{indent}<{element.name}", *words])
    if element.text:
        yield f"{start}>{_escaped(element.text, _ESCAPES)}</{element.name}>"
    elif not element.children:
        yield f"{start}/>"
    else:
        yield f"{start}>"
        for child in element.children:
            yield from _lines(child, indent + "  ")
        for comment in element.end_comments:
            yield f"{indent}  <!-- {_in_comment(comment)} -->"
        yield f"{indent}</{element.name}>"


def _in_comment(text: str) -> str:
    """Return the text with double hyphens split, which would end the comment."""
    return re.sub(r"-(?=-|$)", "- ", text).rstrip()


def _escaped(text: str, escapes: dict[str, str]) -> str:
    return "".join(escapes.get(character, character) for character in text)

"""The table of a recovery, `when:`, as a schema: every cause and family, and what it means."""

from __future__ import annotations

from collections.abc import Iterable

from ...world.causes import OUR_PREFIXES, Cause
from .schema_parts import Schema, escaped, ref


def causes_schema(causes: Iterable[Cause], patterns: Iterable[str], *, closed: bool) -> Schema:
    """`patterns` are the causes' names, their families and `*`. `closed`: there are no other causes."""
    known = {cause.name: cause for cause in causes}
    properties: dict[str, Schema] = {}
    for pattern in patterns:
        cause = known.get(pattern)
        properties[pattern] = _handler(cause_markdown(cause) if cause else _family(pattern, known))
    found: Schema = {"type": "object", "minProperties": 1, "properties": properties}
    if closed:
        return found | {"additionalProperties": False}
    own = "|".join(map(escaped, OUR_PREFIXES))
    foreign = rf"^(?!(?:{own})\.)[a-z][A-Za-z0-9_]*(?:\.[a-z][A-Za-z0-9_]*)*(?:\.\*)?(?![\s\S])"
    return found | {"patternProperties": {foreign: ref("child")}, "additionalProperties": False}


def cause_markdown(cause: Cause) -> str:
    """The cause in a sentence, and what to try first."""
    return f"{cause.sentence} First remedy: {cause.remedy}."


def _family(pattern: str, known: Iterable[str]) -> str:
    if pattern == "*":
        return "Every cause but `internal.error`, a fault of the program."
    return "Any of " + ", ".join(f"`{name}`" for name in known if name.startswith(pattern[:-1])) + "."


def _handler(markdown: str) -> Schema:
    said: Schema = {"description": markdown.replace("`", ""), "markdownDescription": markdown}
    # First of all, so that the cause is explained and not the node that handles it.
    return {"allOf": [said, ref("child")]} | said

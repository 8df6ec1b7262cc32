"""The table of a recovery, `when:`, as a schema: every cause and family, and what it means."""

from __future__ import annotations

import re

from ...world.causes import FAMILIES, Cause, all_causes
from .parts import Schema, ref

_OWN = tuple(family.__name__ for family in FAMILIES)


def causes_schema(*, closed: bool) -> Schema:
    """`closed`: no plug-in brings causes other than those that are registered now."""
    causes = [cause for cause in all_causes() if closed or cause.name.split(".")[0] in _OWN]
    families = dict.fromkeys(cause.name.rpartition(".")[0] for cause in causes)
    properties: dict[str, Schema] = {cause.name: _handler(cause_markdown(cause)) for cause in causes}
    for family in families:
        members = [cause.name for cause in causes if cause.name.startswith(f"{family}.")]
        properties[f"{family}.*"] = _handler("Any of " + ", ".join(f"`{name}`" for name in members) + ".")
    properties["*"] = _handler("Every cause but `internal.error`, a fault of the program.")
    found: Schema = {"type": "object", "minProperties": 1, "properties": properties}
    if closed:
        return found | {"additionalProperties": False}
    own = "|".join(_OWN)
    foreign = rf"^(?!(?:{own})\.)[a-z][A-Za-z0-9_]*(?:\.[a-z][A-Za-z0-9_]*)*(?:\.\*)?(?![\s\S])"
    return found | {"patternProperties": {foreign: ref("child")}, "additionalProperties": False}


def cause_markdown(cause: Cause) -> str:
    """The cause in a sentence, and what to try first."""
    return f"{cause.sentence} First remedy: {cause.remedy}."


def _handler(markdown: str) -> Schema:
    plain = re.sub("`", "", markdown)
    said: Schema = {"description": plain, "markdownDescription": markdown}
    # First of all, so that the cause is explained and not the node that handles it.
    return {"allOf": [said, ref("child")]} | said

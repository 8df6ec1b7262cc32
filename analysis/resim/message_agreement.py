"""Whether a message says what the recorded one says: in the same bytes, or at least in the same values."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import PurePath
from typing import cast

import orjson

from ...logs.recording import foxglove_messages as messages
from ...logs.schema import topics
from ...trees.mission import MAIN
from ..compare.message_fields import FieldDifference, first_field

_SCENES = (topics.OBJECTS.name, topics.TRUTH.name)


def disagreement(
    topic: str, schema: str, recorded: bytes, now: bytes, *, older: bool
) -> FieldDifference | None:
    """The first field in which two messages differ; None when they agree.

    `older`: the recorded one is of a version that wrote less. What it lacks is passed over then.
    """
    if recorded == now:
        return None
    if not older:
        return first_field(schema, recorded, now) or FieldDifference("", "", None, None)
    if topic in _SCENES:
        if messages.read_scene(recorded) == messages.read_scene(now):
            return None
    elif schema.startswith("picktree."):
        now = orjson.dumps(_reduced(orjson.loads(recorded), orjson.loads(now)))
    return first_field(schema, recorded, now)


def of_common_nodes(recorded: bytes, now: bytes) -> tuple[bytes, bytes]:
    """Two ticks of different trees, without the nodes that only one of them has: what such a node does shows
    when it begins."""
    one, other = orjson.loads(recorded), orjson.loads(now)
    paths = {node["path"] for node in one["nodes"]} & {node["path"] for node in other["nodes"]}
    for tick in (one, other):
        tick["nodes"] = sorted((n for n in tick["nodes"] if n["path"] in paths), key=lambda n: n["path"])
    return orjson.dumps(one), orjson.dumps(other)


def what_happens(data: bytes, settings: Collection[str]) -> bytes:
    """A tick without the inputs of its nodes and without what is written of these parameters."""
    tick = orjson.loads(data)
    for transition in tick.get("transitions", ()):
        transition.pop("inputs", None)
    keys = {f"{MAIN}/{name}" for name in settings}
    tick["writes"] = [write for write in tick["writes"] if write["key"] not in keys]
    return orjson.dumps(tick)


def _reduced(like: object, value: object) -> object:
    """The value without the fields that the other lacks, and with its spelling of where a mesh came from."""
    if isinstance(like, dict) and isinstance(value, dict):
        wanted, given = cast("dict[str, object]", like), cast("dict[str, object]", value)
        return {
            key: wanted[key]
            if _same_file(key, wanted[key], given[key])
            else _reduced(wanted[key], given[key])
            for key in wanted
            if key in given
        }
    if isinstance(like, list) and isinstance(value, list):
        ones, others = cast("list[object]", like), cast("list[object]", value)
        return [_reduced(ones[n], other) if n < len(ones) else other for n, other in enumerate(others)]
    return value


def _same_file(key: str, one: object, other: object) -> bool:
    both = isinstance(one, str) and isinstance(other, str)
    return key == "source" and both and PurePath(str(one)).name == PurePath(str(other)).name

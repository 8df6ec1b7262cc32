"""Events in a log: the kinds that the recorder itself adds, and the conversion of events into records."""

from __future__ import annotations

import types
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Self, cast, get_args

from picktree.world import EVENT_KINDS, JournalEvent, OtherEvent, RecordField, event_fields, event_types

from .json_schema import is_viewable, schema, value_schema
from .log_records import BodyRecord, Event, decode, record_adapter


class ImageEvent(JournalEvent, kind="image"):
    """Image of a camera."""

    findings: Annotated[tuple[str, ...], "results of perception in it, a line each"] = ()


class BeliefEvent(JournalEvent, kind="belief"):
    """Change of the belief."""

    version: Annotated[int, "version of the belief after the change"]
    object: Annotated[str, "id of the object in the belief"]
    reason: Annotated[str, "reason of the change"]
    before: Annotated[BodyRecord | None, "object before the change; null for a new one"]
    after: Annotated[BodyRecord | None, "object after the change; null for one that was removed"]

    @classmethod
    def from_data(cls, message: str, node: str, data: Mapping[str, object]) -> Self:
        """Return the event with these values. Raises ValueError when one is missing or has another type."""
        bodies = {name: _body(data.get(name)) for name in ("before", "after")}
        plain = super().from_data(message, node, {**data, "before": None, "after": None})
        return cls(
            message, node, extra=plain.extra, version=plain.version, object=plain.object, reason=plain.reason,
            before=bodies["before"], after=bodies["after"],
        )  # fmt: skip


def event_record(event: JournalEvent) -> Event:
    """Return the record of an event."""
    return Event(event.kind, event.message, event.node, event.data)


def decode_event(data: bytes) -> JournalEvent:
    """Decode an event. One of an unknown kind, or without a value that its kind needs, is an `OtherEvent`."""
    record = decode(Event, data)
    return event_types.event_of(record.kind, record.message, record.node, record.data)


def event_schema() -> dict[str, object]:
    """Return the JSON Schema of a message on `/events`: the values of each declared kind, and any other kind.

    Viewers read `properties` alone. The values of `data` that are listed there have one type in every kind.
    """
    return _event_schema(tuple(EVENT_KINDS.values()))


@cache
def _event_schema(kinds: tuple[type[JournalEvent], ...]) -> dict[str, object]:
    common = schema(Event)
    properties = cast("dict[str, object]", common["properties"])
    data = {"type": "object", "properties": _shared_values(kinds)}
    other = {"properties": {"kind": {"not": {"enum": [kind.NAME for kind in kinds]}}}}
    return {
        **common,
        "properties": {**properties, "data": data},
        "oneOf": [*map(_kind_schema, kinds), {"title": OtherEvent.__name__, **other}],
    }


def _kind_schema(kind: type[JournalEvent]) -> dict[str, object]:
    """Return the schema that holds for the events of one kind, beside that of every event.

    It has no descriptions: each file of a log holds it twice, and writes it anew each second.
    """
    values = event_fields(kind)
    data = {
        "properties": {each.name: value_schema(each.hint) for each in values},
        "required": [each.name for each in values if each.required],
    }
    return {"title": kind.__name__, "properties": {"kind": {"const": kind.NAME}, "data": data}}


def _shared_values(kinds: Iterable[type[JournalEvent]]) -> dict[str, dict[str, object]]:
    """Return the schemas of the values that have one type in all kinds that have them, and are never null."""
    found: dict[str, list[dict[str, object]]] = {}
    for kind in kinds:
        for each in event_fields(kind):
            found.setdefault(each.name, []).append(value_schema(_recorded_type(kind, each)))
    alike = {
        name: schemas[0] for name, schemas in found.items() if all(each == schemas[0] for each in schemas)
    }
    return {name: schemas for name, schemas in alike.items() if is_viewable(schemas)}


def _recorded_type(kind: type[JournalEvent], value: RecordField) -> object:
    """Return the type of a recorded value. One whose default is None is left out while it is None."""
    arms = [arm for arm in get_args(value.hint) if arm is not types.NoneType]
    left_out = value.default is None and kind.data is JournalEvent.data
    return arms[0] if left_out and len(arms) == 1 else value.hint


def _body(value: object) -> BodyRecord | None:
    return None if value is None else record_adapter(BodyRecord).validate_python(value)

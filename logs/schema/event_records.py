"""Events in a log: the kinds that the recorder itself adds, and the way between events and their records."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Self

from ...world.events.event_kinds import event_of
from ...world.journal import EVENT_KINDS, JournalEvent, field_meanings
from .json_records import decode
from .records import BodyRecord, Event

if TYPE_CHECKING:
    from pydantic import TypeAdapter

_PAGE = """\
# Events

A message on the topic `/events` of a [log](logs.md) has `kind`, `message`, `node` and `data`. `node` is the
path of the node that noted it, empty when none did. These are the kinds, with the values in their `data`.

In Python each kind is a class and each value an attribute: `at.record.object` for `at` in `run.events`
([analysis.md](analysis.md)). An event of another kind, or one that lacks a value, is an `OtherEvent` with
what was recorded in `data`.

| kind | recorded when | values |
|---|---|---|
"""


@dataclass(frozen=True, kw_only=True)
class ImageEvent(JournalEvent, kind="image"):
    """A camera took an image."""

    findings: Annotated[tuple[str, ...], "what perception found in it, a line each"] = ()


@dataclass(frozen=True, kw_only=True)
class BeliefEvent(JournalEvent, kind="belief"):
    """The belief changed."""

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
    return event_of(record.kind, record.message, record.node, record.data)


def events_page() -> str:
    """Return the page `docs/events.md`: all kinds of event with their fields."""
    rows = (
        f"| `{name}` | {(inspect.getdoc(kind) or '').splitlines()[0]} | {_values(kind)} |"
        for name, kind in sorted(EVENT_KINDS.items())
    )
    return _PAGE + "\n".join(rows) + "\n"


def _values(kind: type[JournalEvent]) -> str:
    return "<br>".join(f"`{name}`: {meaning}" for name, meaning in field_meanings(kind).items())


def _body(value: object) -> BodyRecord | None:
    return None if value is None else _body_adapter().validate_python(value)


@cache
def _body_adapter() -> TypeAdapter[BodyRecord]:
    from pydantic import TypeAdapter  # needed for reading only, and slow to import

    return TypeAdapter[Any](BodyRecord)

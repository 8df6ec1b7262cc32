"""Page `docs/events.md`, made from the declarations of the kinds of event. `make docs` writes it."""

from __future__ import annotations

import inspect

from picktree.logs import BeliefEvent  # noqa: F401 - with it all kinds are declared
from picktree.world import EVENT_KINDS, JournalEvent, event_fields

_PAGE = """\
# Events

A message on the topic `/events` of a [log](logs.md) has `kind`, `message`, `node` and `data`. `node` is the
path of the node that noted it, empty when none did. These are the kinds, with the values in their `data`.

In Python each kind is a class and each value an attribute: `at.record.object` for `at` in `run.events`
([analysis.md](analysis.md)). An event of another kind, or one that lacks a value, is an `OtherEvent` with
what was recorded in `data`.

The JSON Schema of the topic, which each log holds, has an alternative for each kind, for the kinds that
plug-ins declare, and one for all others. Viewers are offered the values that have one type in every kind;
a plug-in whose value has such a name and another type declares its kind as a class below `JournalEvent`.

| kind | recorded when | values |
|---|---|---|
"""


def events_page() -> str:
    """Return the page `docs/events.md`: all kinds of event with their fields."""
    rows = (
        f"| `{name}` | {(inspect.getdoc(kind) or '').splitlines()[0]} | {_values(kind)} |"
        for name, kind in sorted(EVENT_KINDS.items())
    )
    return _PAGE + "\n".join(rows) + "\n"


def _values(kind: type[JournalEvent]) -> str:
    return "<br>".join(f"`{each.name}`: {each.text}" for each in event_fields(kind))


if __name__ == "__main__":
    print(events_page(), end="")

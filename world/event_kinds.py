"""Kinds of event of all rooms, and the way from recorded values to an event."""

from __future__ import annotations

from collections.abc import Mapping

from . import run_events, skill_events
from .journal import EVENT_KINDS, JournalEvent, OtherEvent

_DECLARING_MODULES = (run_events, skill_events)
"""Modules whose import declares the kinds."""


def event_of(kind: str, message: str, node: str, data: Mapping[str, object]) -> JournalEvent:
    """Return the event of a kind by its name and recorded values, as a log or a plug-in has them."""
    declared = EVENT_KINDS.get(kind)
    if declared is not None:
        try:
            return declared.from_data(message, node, data)
        except ValueError:
            pass
    return OtherEvent(message, node, name=kind, extra=data)

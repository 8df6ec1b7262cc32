"""The trace of a case as text: a line for each thing that leaves and control nodes do."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from ....world.journal import Plain
from ..stage.events import Ended, Event, Failed, Handled, LeafRun, Settled, Started, Wrote

_WIDEST = 44
"""Longest name of a node; a longer one moves the rest of its line."""


def trace_lines(events: tuple[Event, ...], names: Mapping[str, str]) -> list[str]:
    """One line for each start and end of a leaf (one for both where nothing happens between), write, failure
    that is taken up, and note; `names` says how nodes are called by their paths."""
    rows = [(when, names.get(path, path), what) for when, path, what in _rows(events)]
    wide = max((len(when) for when, _, _ in rows), default=0)
    width = min(_WIDEST, max((len(name) for _, name, _ in rows), default=0))
    return [f"  {when:>{wide}}  {name:<{width}}  {what}".rstrip() for when, name, what in rows]


def _rows(events: tuple[Event, ...]) -> Iterator[tuple[str, str, str]]:
    """Tick or ticks, the node's path, what it does."""
    for index, event in enumerate(events):
        if isinstance(event, Started):
            written, after = _writes(events, index + 1, event.run)
            ended = events[after] if after < len(events) else None
            if isinstance(ended, Ended) and ended.run is event.run:
                yield _ticks(event.run), event.run.path, _ending(event.run, written)
                continue
            yield f"{event.tick}", event.run.path, "starts"
        elif isinstance(event, Ended):
            if not _in_one_line(events, index):
                yield f"{event.tick}", event.run.path, _ending(event.run, {})
        elif isinstance(event, Wrote):
            if not _told_with_its_run(events, index):
                yield f"{event.tick}", event.path, f"{event.key.rpartition('/')[2]} = {show(event.value)}"
        elif isinstance(event, Settled):
            yield f"{event.tick}", event.path, event.status.value
        elif isinstance(event, Failed):
            yield f"{event.tick}", event.path, f"FAILURE {event.cause}: {event.message}"
        elif isinstance(event, Handled):
            handler = f" with '{event.handler}'" if event.handler else ""
            yield f"{event.tick}", event.by, f"takes up {event.cause}{handler}"
        else:
            yield f"{event.tick}", event.path, event.message


def _writes(events: tuple[Event, ...], index: int, run: LeafRun) -> tuple[dict[str, Plain], int]:
    """What a leaf writes right after it has started, and where the events go on."""
    written: dict[str, Plain] = {}
    while index < len(events):
        event = events[index]
        if not isinstance(event, Wrote) or event.path != run.path:
            break
        written[event.key.rpartition("/")[2]] = event.value
        index += 1
    return written, index


def _in_one_line(events: tuple[Event, ...], index: int) -> bool:
    """Whether an end was told together with its start."""
    ended = events[index]
    while index > 0 and isinstance(events[index - 1], Wrote):
        index -= 1
    before = events[index - 1] if index > 0 else None
    return isinstance(ended, Ended) and isinstance(before, Started) and before.run is ended.run


def _told_with_its_run(events: tuple[Event, ...], index: int) -> bool:
    while index < len(events) and isinstance(events[index], Wrote):
        index += 1
    return index < len(events) and isinstance(events[index], Ended) and _in_one_line(events, index)


def _ticks(run: LeafRun) -> str:
    return f"{run.tick}" if run.last in (None, run.tick) else f"{run.tick}–{run.last}"


def _ending(run: LeafRun, written: Mapping[str, Plain]) -> str:
    what = f"FAILURE {run.cause}: {run.message}" if run.cause else run.outcome
    outputs = ", ".join(f"{key} = {show(value)}" for key, value in written.items())
    return f"{what}  {outputs}" if outputs else what


def show(value: Plain) -> str:
    """A value of the blackboard as YAML writes it in one line, cut where it is long."""
    match value:
        case None:
            text = "null"
        case bool():
            text = str(value).lower()
        case list():
            text = f"[{', '.join(map(show, value))}]"
        case dict():
            text = "{" + ", ".join(f"{key}: {show(item)}" for key, item in value.items()) + "}"
        case _:
            text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def short_names(paths: Collection[str]) -> dict[str, str]:
    """For each path the shortest end of it that no other has.

    >>> short_names(["Main/A/Grasp", "Main/A/Place", "Main/B/Place"])["Main/B/Place"]
    'B/Place'
    """
    ends: dict[str, int] = {}
    for path in paths:
        parts = path.split("/")
        for n in range(len(parts)):
            end = "/".join(parts[n:])
            ends[end] = ends.get(end, 0) + 1
    short: dict[str, str] = {}
    for path in paths:
        parts = path.split("/")
        every = ["/".join(parts[n:]) for n in range(len(parts) - 1, -1, -1)]
        short[path] = next((end for end in every if ends[end] == 1), path)
    return short

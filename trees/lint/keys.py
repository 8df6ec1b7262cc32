"""Keys of the blackboard: read before they are written, written and never read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ...world.files.document import Fault, nearest
from ..flow.walk import Read
from .survey import Survey
from .usage import Touch, Usage


def read_before_written(survey: Survey) -> Iterator[Fault]:
    """P301, P302: a key that nothing, or not everything on the way, has written."""
    for read in survey.walk.reads.values():
        if not read.missing or not survey.own(read.spec.mark):
            continue
        usage = survey.usage[read.tree]
        what = f"port {read.place!r}" if read.place in read.spec.ports else read.place
        writers = [touch for touch in usage.writes.get(read.key, ()) if touch.spec is not read.spec]
        if read.ever:
            message = f"{what}: perhaps nothing has written {read.key!r} yet"
            hint = f"{_writer(survey, writers)} may fail or be passed by before" if writers else ""
            yield survey.fault(read.spec, message, hint, code="P302", at=read.place)
        else:
            message = f"{what}: nothing has written {read.key!r} when it is read"
            hint = _remedy(survey, read, usage, writers)
            yield survey.fault(read.spec, message, hint, code="P301", at=read.place, error=True)


def _remedy(survey: Survey, read: Read, usage: Usage, writers: list[Touch]) -> str:
    if writers:
        return f"{_writer(survey, writers)} comes later"
    inputs = (port.key for port in survey.mission.trees[read.tree].ports)
    known = dict.fromkeys((*inputs, *usage.writes))
    return (
        nearest(read.key, (key for key in known if key != read.key))
        if known
        else "nothing writes any key here"
    )


def _writer(survey: Survey, writers: Iterable[Touch]) -> str:
    spec = next(iter(writers)).spec
    return f"{spec.name}, line {spec.mark.line},"


def never_read(survey: Survey) -> Iterator[Fault]:
    """P303: an output, or an assignment, that nothing reads."""
    for tree in survey.trees():
        usage = survey.usage[tree.name]
        outputs = {port.key for port in tree.ports if port.direction == "out"}
        for key, touches in usage.writes.items():
            if key in usage.reads or key in outputs:
                continue
            first = touches[0]
            message = f"{first.at}: {key!r} is written, and nothing in {tree.name} reads it"
            hint = nearest(key, (read for read in usage.reads if read not in usage.writes))
            hint = hint if hint.startswith("did you mean") else "an output that nobody needs is left out"
            yield survey.fault(first.spec, message, hint, code="P303", at=first.at)

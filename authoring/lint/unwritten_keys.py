"""Keys of the blackboard: read before they are written, written and never read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ...files.yaml.document import Diagnostic, suggest_name
from ...trees.flow.key_reading import KeyRead
from .mission_survey import KeyAccess, KeyUsage, LintModel


def read_before_written(survey: LintModel) -> Iterator[Diagnostic]:
    """P301, P302: a key that nothing, or not everything on the way, has written."""
    for read in survey.walk.reads.values():
        if not read.missing or not survey.own(read.spec.mark):
            continue
        usage = survey.usage[read.tree]
        what = f"port {read.place!r}" if read.place in read.spec.ports else read.place
        writers = [touch for touch in usage.writes.get(read.key, ()) if touch.spec is not read.spec]
        if read.ever:
            message = f"{what}: perhaps nothing has written {read.key!r} yet"
            hint = _writer(read, writers) if writers else ""
            yield survey.fault(read.spec, message, hint, code="P302", at=read.place)
        else:
            message = f"{what}: nothing has written {read.key!r} when it is read"
            hint = _remedy(survey, read, usage, writers)
            yield survey.fault(read.spec, message, hint, code="P301", at=read.place, error=True)


def _writer(read: KeyRead, writers: Iterable[KeyAccess]) -> str:
    spec = next(iter(writers)).spec
    where = f"{spec.name}, line {spec.mark.line}, writes it"
    before = spec.mark < read.spec.places.get(read.place, read.spec.mark)
    return f"{where}, but may fail or be passed by" if before else f"{where}, further down"


def _remedy(survey: LintModel, read: KeyRead, usage: KeyUsage, writers: list[KeyAccess]) -> str:
    if writers:
        return _writer(read, writers)
    inputs = (port.key for port in survey.mission.trees[read.tree].ports)
    known = [key for key in dict.fromkeys((*inputs, *usage.writes)) if key != read.key]
    return suggest_name(read.key, known) if known else f"nothing in {read.tree} writes any key"


def never_read(survey: LintModel) -> Iterator[Diagnostic]:
    """P303: an output, or an assignment, that nothing reads."""
    for tree in survey.trees():
        usage = survey.usage[tree.name]
        outputs = {port.key for port in tree.ports if port.direction == "out"}
        for key, touches in usage.writes.items():
            if key in usage.reads or key in outputs:
                continue
            first = touches[0]
            message = f"{first.at}: {key!r} is written, and nothing in {tree.name} reads it"
            hint = suggest_name(key, (read for read in usage.reads if read not in usage.writes))
            hint = hint if hint.startswith("did you mean") else "an output that nobody needs is left out"
            yield survey.fault(first.spec, message, hint, code="P303", at=first.at)

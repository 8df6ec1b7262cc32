"""Rules about constants at ports: times without a unit, objects that no scene has."""

from __future__ import annotations

import re
from collections.abc import Iterator

from picktree.files import Diagnostic
from picktree.trees import Timeout, references

from .mission_survey import LintModel

MIN_BARE_TIMEOUT = 500.0
"""Number of a Timeout below which one without a unit is taken for seconds, ms."""


def short_timeouts(survey: LintModel) -> Iterator[Diagnostic]:
    """P345: a Timeout of a bare number that is no longer than some ticks."""
    for spec in survey.nodes(Timeout):
        bound = spec.ports.get("msec")
        if (
            isinstance(bound, references.Constant)
            and isinstance(bound.text, int | float)
            and bound.text < MIN_BARE_TIMEOUT
        ):
            message = (
                f"{bound.text:g} is in milliseconds, and one tick takes 50 ms: almost nothing can "
                "end in this time"
            )
            hint = f"write {bound.text:g} s, or {bound.text:g} ms if milliseconds are meant"
            yield survey.fault(spec, message, hint, code="P345", at="msec")


def unknown_objects(survey: LintModel) -> Iterator[Diagnostic]:
    """P346: the name of an object that no object of the scene will have."""
    known = survey.known
    if known is None:
        return
    kinds = known.names.get("kind", ())
    # Names that perception and `PickAny` give, whatever the catalogue says.
    patterns = (r"(obstacle|thing)_\d+", *(rf"\w+_{re.escape(kind)}_\d+" for kind in kinds))
    for spec in survey.nodes():
        for port in spec.node.declaration.ports if spec.node is not None else ():
            bound = spec.ports.get(port.key)
            if (
                port.type.name != "object"
                or port.names
                or not isinstance(bound, references.Constant)
                or not bound.value
            ):
                continue
            name = str(bound.value)
            if not any(re.fullmatch(pattern, name) for pattern in patterns):
                message = f"port {port.key!r}: no object of the scene {known.scene!r} gets the name {name!r}"
                like = f"colour, kind and number, as 'red_{kinds[0]}_1'" if kinds else "'thing' and a number"
                hint = f"a name is {like}; or a key, as '{{item}}'"
                yield survey.fault(spec, message, hint, code="P346", at=port.key)

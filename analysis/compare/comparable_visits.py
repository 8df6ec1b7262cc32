"""The visits of two runs in the same terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...logs.visits import Visit
from ...logs.visits_format_1 import derived_visits
from ..run import Run


@dataclass(frozen=True, slots=True)
class BothVisits:
    """`derived`: they follow from the statuses after each tick, because one log is of format 1 and tells no
    more; then what nodes read, and which object they were told of, is not known of either."""

    a: Sequence[Visit]
    b: Sequence[Visit]
    derived: bool


def both_visits(a: Run, b: Run) -> BothVisits:
    if a.log.format < 2 or b.log.format < 2:
        return BothVisits(derived_visits(a.log), derived_visits(b.log), derived=True)
    return BothVisits(a.visits, b.visits, derived=False)

"""The visits of a run as a family: who took place within whom, and who stood where in the tree."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

from ....logs.visits import Visit


class Family:
    """Visits by number, their children in the order of their beginnings."""

    def __init__(self, visits: Sequence[Visit]) -> None:
        self.visits = tuple(visits)
        self._children: dict[int, list[Visit]] = defaultdict(list)
        for visit in self.visits:
            if visit.parent is not None:
                self._children[visit.parent].append(visit)

    def children(self, visit: Visit) -> Sequence[Visit]:
        return self._children.get(visit.number, ())

    def parent(self, visit: Visit) -> Visit | None:
        return None if visit.parent is None else self.visits[visit.parent]

    def above(self, visit: Visit) -> Iterator[Visit]:
        """The visits around it, the nearest first."""
        parent = self.parent(visit)
        while parent is not None:
            yield parent
            parent = self.parent(parent)

    def within(self, visit: Visit, other: Visit) -> bool:
        """Whether `visit` took place within `other`, or is it."""
        return visit.number == other.number or any(v.number == other.number for v in self.above(visit))

    def came_from(self, visit: Visit) -> Visit | None:
        """The child from which a failure came up; None when it came from the visit itself.

        The last one counts: a node that tries again fails with its last failure.
        """
        return next((child for child in reversed(self.children(visit)) if _same(child, visit)), None)

    def sources(self) -> Iterator[Visit]:
        """The visits in which failures came up, in the order in which they ended."""
        failed = (v for v in self.visits if v.outcome == "FAILURE" and v.cause)
        found = (v for v in failed if self.came_from(v) is None)
        yield from sorted(found, key=lambda v: (v.last, v.number))

    def after(self, visit: Visit) -> Sequence[Visit]:
        """Those of the same parent that began when it had ended."""
        parent = self.parent(visit)
        if parent is None:
            return ()
        return [v for v in self.children(parent) if v.number > visit.number and v.first >= visit.last]


def _same(child: Visit, parent: Visit) -> bool:
    return (
        child.outcome == "FAILURE"
        and child.cause == parent.cause
        and child.origin == parent.origin
        and child.message == parent.message
    )

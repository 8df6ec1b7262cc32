"""Why a node may fail: causes as a set of bits, and which nodes of the text they come from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...world.causes import Cause, Family, all_causes, matches

if TYPE_CHECKING:
    from ...trees.mission import NodeSpec

UNREPORTED = 1
"""The bit of a failure without a report: a condition that does not hold."""
ALL = -1


class CauseBits:
    """One bit for each cause that is registered when this is made; bit 0 is `UNREPORTED`."""

    def __init__(self) -> None:
        self._causes = all_causes()
        self._bits = {cause.name: 2 << index for index, cause in enumerate(self._causes)}
        self._matching: dict[str, int] = {}

    def of(self, declared: Iterable[Cause | Family]) -> int:
        """Those that a node declares."""
        mask = 0
        for one in declared:
            mask |= self.matching(str(one))
        return mask

    def matching(self, pattern: str) -> int:
        """Those that a pattern of `when:` covers."""
        if pattern not in self._matching:
            bits = (self._bits[cause.name] for cause in self._causes if matches(pattern, cause))
            self._matching[pattern] = sum(bits)
        return self._matching[pattern]

    def names(self, mask: int) -> tuple[str, ...]:
        """The names of a set, in the order of their registration."""
        return tuple(name for name, bit in self._bits.items() if mask & bit)

    def words(self, mask: int) -> str:
        """The set as a mission would write it: whole families as `family.*`."""
        families: dict[str, list[str]] = {}
        for name in self._bits:
            families.setdefault(name.rpartition(".")[0], []).append(name)
        parts: list[str] = []
        for family, names in families.items():
            given = [name for name in names if mask & self._bits[name]]
            if len(given) == len(names) > 1:
                parts.append(f"{family}.*")
            else:
                parts += given
        return ", ".join(parts)


@dataclass(frozen=True, slots=True, eq=False)
class FailureReasons:
    """Causes that a failure may have. `quiet` ones are possible although no node declares them.

    Where they come from is kept as a graph, read only for what is reported: `origin` raised them itself;
    else they are those of `inner` as far as `keep` lets them through, `met` by a node that tried a cure, on
    their way out of the sub-tree that `call` runs.
    """

    loud: int
    quiet: int
    origin: NodeSpec | None = None
    inner: tuple[FailureReasons, ...] = ()
    keep: int = ALL
    met: bool = False
    call: NodeSpec | None = None

    @property
    def any(self) -> int:
        return self.loud | self.quiet

    def only(self, mask: int) -> FailureReasons:
        """Those of the mask."""
        if self.any & ~mask == 0:
            return self
        return FailureReasons(self.loud & mask, self.quiet & mask, inner=(self,), keep=mask)

    def tried(self) -> FailureReasons:
        """The same after a node has tried something against them."""
        return FailureReasons(self.loud, self.quiet, inner=(self,), met=True)

    def through(self, call: NodeSpec) -> FailureReasons:
        """The same, seen from where the sub-tree is used."""
        return FailureReasons(self.loud, self.quiet, inner=(self,), call=call)

    def sources(self, own: str) -> Iterator[CauseOrigin]:
        """The nodes that raise these; for one in another file than `own`, where that file uses it."""
        seen: set[tuple[int, int, bool, int]] = set()
        todo: list[tuple[FailureReasons, int, bool, NodeSpec | None]] = [(self, ALL, False, None)]
        while todo:
            reasons, mask, met, call = todo.pop()
            mask &= reasons.keep
            key = (id(reasons), mask, met, id(call))
            if key in seen or not reasons.any & mask:
                continue
            seen.add(key)
            met = met or reasons.met
            if reasons.origin is not None:
                there = None if reasons.origin.mark.file == own else call
                yield CauseOrigin(reasons.origin, there or reasons.origin, reasons.loud & mask, met)
            if reasons.call is not None and reasons.call.mark.file == own:
                call = reasons.call
            todo.extend((inner, mask, met, call) for inner in reversed(reasons.inner))


@dataclass(frozen=True, slots=True)
class CauseOrigin:
    """A node that raises causes; `at` is where the mission's own file names it or what leads to it."""

    node: NodeSpec
    at: NodeSpec
    causes: int
    met: bool


NO_REPORT = FailureReasons(UNREPORTED, 0)
"""A condition does not hold."""


def joined(parts: Iterable[FailureReasons]) -> FailureReasons:
    """The reasons of all of them."""
    distinct = tuple({id(part): part for part in parts}.values())
    if len(distinct) == 1:
        return distinct[0]
    loud = quiet = 0
    for part in distinct:
        loud |= part.loud
        quiet |= part.quiet
    return FailureReasons(loud, quiet & ~loud, inner=distinct)

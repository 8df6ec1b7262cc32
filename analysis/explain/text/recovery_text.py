"""Recovery as text: a small table of the causes that were seen, and the planted faults beside it."""

from __future__ import annotations

from collections.abc import Iterator

from ....files.diagnostics.fault_rendering import Paint
from ....logs.episodes.episode import Planted
from ....logs.episodes.episode_counts import ENDS, CauseCount
from ..investigation.episodes_of_log import Episodes
from ..investigation.number_wording import counted, wrapped

PLANTED = 12
"""Planted faults that are told."""


def recovery_lines(found: Episodes, paint: Paint) -> Iterator[str]:
    """Nothing when nothing failed and nothing was planted."""
    if found.episodes:
        yield paint(_title(found), "place")
        width = max(5, *(len(each.cause) for each in found.causes))
        yield f"  {'cause':<{width}}  seen  cured  tries   s lost  by"
        for each in found.causes:
            total, tries = each.total, each.total.tries_a_cure
            said = "" if tries is None else f"{tries:.1f}"
            numbers = f"{total.seen:>4}  {total.cured:>5}  {said:>5}  {total.seconds:>7.1f}"
            row = f"  {each.cause:<{width}}  {numbers}  "
            first, *rest = wrapped(_by(each), " " * len(row))
            yield row + first.strip()
            yield from rest
    if found.planted:
        yield paint("Faults that were planted, and what failed first after them", "place")
        for fault in found.planted[:PLANTED]:
            yield from wrapped(f"{fault.time:7.2f} s  {fault.message}: {_then(fault)}", "  ", " " * 13)
        if len(found.planted) > PLANTED:
            yield f"  … {len(found.planted) - PLANTED} more (--json)"


def _title(found: Episodes) -> str:
    ends = [(said, sum(e.end == end for e in found.episodes)) for end, said in ENDS.items()]
    told = ", ".join(f"{number} {said}" for said, number in ends if number)
    lost = sum(e.seconds for e in found.episodes)
    return f"Recovery ({counted(len(found.episodes), 'episode')}: {told}; {lost:.1f} s lost)"


def _by(found: CauseCount) -> str:
    """What cured it, else what was tried in vain."""
    cured = [each for each in found.by_cure if each.cured]
    if cured:
        return ", ".join(each.cure if len(cured) == 1 else f"{each.cure} ({each.cured})" for each in cured)
    tried = [each.cure for each in found.by_cure if each.cure]
    if tried:
        return f"tried in vain: {', '.join(tried)}"
    return "given up untried" if found.total.given_up else "nobody"


def _then(fault: Planted) -> str:
    if fault.end is None or fault.after is None:
        return "nothing failed"
    return f"{fault.cause} {fault.after:.1f} s later, {ENDS[fault.end]}"

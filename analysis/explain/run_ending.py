"""How a run ended, in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...logs.visits import Visit
from .investigation.explanation import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...logs.run_record import RunRecord


def outcome_of(run: RunRecord, visits: Sequence[Visit]) -> Outcome:
    end = run.ticks.times[-1] if run.ticks.times else run.end
    result = run.result
    if result is None:
        return Outcome(_status(run), _cut_off(run, visits, end), end, None, None)
    items = result.items
    counts = f"{items.sorted} of {items.total} items are where they belong"
    if items.misplaced:
        counts += f", {items.misplaced} in a wrong bin"
    if items.left:
        counts += f", {items.left} left"
    sentence = {
        "success": f"the mission succeeded and its goal is reached: {counts}",
        "incomplete": f"the mission ended in SUCCESS, but its goal is missed: {counts}",
        "failure": f"the mission ended in FAILURE: {result.message or 'a condition did not hold'}; {counts}",
        "timeout": f"the run was ended at its limit of time{_doing(visits)}; {counts}",
        "paused": f"the run waits for help: {result.message}; {counts}",
        "interrupted": f"the run was interrupted{_doing(visits)}; {counts}",
    }[result.status]
    return Outcome(result.status, sentence, end, items.sorted, items.total)


def _status(run: RunRecord) -> str:
    ended = run.log.result.get("ended", "")
    return "crashed" if ended and ended != "orderly" else "killed"


def _cut_off(run: RunRecord, visits: Sequence[Visit], end: float) -> str:
    ended = run.log.result.get("ended", "")
    if ended and ended != "orderly":
        return f"the run was ended at {end:.2f} s by an error of the program ({ended}){_doing(visits)}"
    return f"the log ends at {end:.2f} s without a result: the process was killed{_doing(visits)}"


def _doing(visits: Sequence[Visit]) -> str:
    """What ran when the log ended."""
    running = [v for v in visits if v.outcome == "RUNNING"]
    if not running:
        return ""
    last = max(running, key=lambda v: (v.path.count("/"), v.number))
    name = last.path.rsplit("/", 1)[-1]
    about = f" of {last.item}" if last.item else ""
    return f" while {name}{about} was running"

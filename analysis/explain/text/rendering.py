"""An explanation as its two renderings: text and one JSON object."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict
from typing import TYPE_CHECKING, cast

from ....files.diagnostics.fault_rendering import Paint, plain
from ....logs.episodes.episode_counts import CauseCount
from ....logs.schema.json_records import encode
from ....world.journal import Plain
from ..investigation.explanation import Explanation
from .explanation_text import Page

if TYPE_CHECKING:
    from ...run import Run


def to_text(
    run: Run,
    found: Explanation,
    log: str,
    *,
    program: str = "picktree",
    paint: Paint = plain,
    everything: bool = False,
) -> str:
    """Without a line's end. `log`: what the reader typed for the log; `program`: how picktree is called."""
    page = Page(found, shlex.quote(log), program, _names(run), paint)
    return page.text(_head(run), notes_on(run), everything=everything)


def to_json_text(run: Run, found: Explanation) -> str:
    """One object, with a line's end: outcome, failures, recovery, root_causes, items, look_at."""
    info = run.info
    outcome = {
        **_plain(found.outcome),
        "mission": info.mission,
        "scene": info.scene,
        "seed": info.seed,
        "backend": info.backend,
        "log": str(run.path),
        "notes": list(notes_on(run)),
    }
    failures = [{**_plain(f), "cured": f.cured, "seconds_lost": f.seconds_lost} for f in found.failures]
    whole = {
        "outcome": outcome,
        "failures": failures,
        "recovery": {
            "causes": [_cause(each) for each in found.recovery.causes],
            "episodes": [
                {**_plain(each), "time": each.time, "cure": each.cure} for each in found.recovery.episodes
            ],
            "planted": [_plain(each) for each in found.recovery.planted],
        },
        "root_causes": [_plain(cause) for cause in found.root_causes],
        "items": [_plain(item) for item in found.items],
        "look_at": [_plain(look) for look in found.look_at],
    }
    return json.dumps(json.loads(encode(whole)), ensure_ascii=False, indent=2) + "\n"


def notes_on(run: Run) -> tuple[str, ...]:
    """What the reader should know of this log before he believes what is said."""
    notes: list[str] = []
    if run.recovered:
        notes.append(run.recovered.removeprefix(f"{run.path}: "))
    if run.log.format < 2:
        notes.append(
            f"the log is of format {run.log.format}: when nodes began and ended is derived from their "
            "statuses, and what they read is not known"
        )
    edits = [at.time for at in run.events if at.record.kind == "mission_edited"]
    if edits:
        told = ", ".join(f"{time:.2f} s" for time in edits)
        notes.append(f"the mission was edited while it ran, at {told}; nodes are those of their time")
    return tuple(notes)


def _head(run: Run) -> str:
    info = run.info
    length = run.ticks.times[-1] if run.ticks.times else run.end
    return f"{info.mission}, scene {info.scene}, seed {info.seed}, {info.backend}: {length:.1f} s simulated"


def _names(run: Run) -> dict[str, str]:
    """Short names of all nodes of all the run's trees, by path."""
    from ...compare.short_names import short_names

    paths = [node.path for at in run.trees for node in at.record.nodes]
    return dict(short_names(paths))


def _cause(found: CauseCount) -> dict[str, Plain]:
    """All episodes of one cause, with what was tried in `by`."""
    parts: list[Plain] = [_plain(each) for each in found.by_cure]
    return {**_plain(found.total), "by": parts}


def _plain(value: object) -> dict[str, Plain]:
    return cast("dict[str, Plain]", asdict(value))  # type: ignore[call-overload]

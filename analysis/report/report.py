"""Report of a run: one HTML file that needs neither a network nor picktree."""

from __future__ import annotations

import base64
import hashlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from string import Template
from typing import Final, cast

import numpy as np
import orjson

from picktree import __version__
from picktree.analysis import Run
from picktree.analysis.explain import ExplainedOutcome, cause_account
from picktree.authoring import svg_drawing
from picktree.files import PicktreeError, file_system
from picktree.world import Plan

from .board_panel import pack_board
from .node_panels import pack_lanes, pack_tree
from .packing import Packable, Section, StringTable, pack
from .sensor_panels import pack_images, pack_plots
from .stage_panel import pack_stage


def pack_failures(run: Run) -> Section:
    """Pack all of `run.explanation`, field by field, with the causes of its episodes in `causes`."""
    explanation = run.explanation
    named = {field.name: plain_value(getattr(explanation, field.name)) for field in fields(explanation)}
    counts = ("to_cure", "cured", "done_instead", "seconds")
    causes: list[Packable] = [
        {"cause": c.cause, **{name: getattr(c.total, name) for name in counts}, "told": c.to_text()}
        for c in explanation.recovery.causes
    ]
    roots: list[Packable] = [
        {"account": cause_account(explanation, root), **cast("dict[str, Packable]", plain_value(root))}
        for root in explanation.root_causes
    ]
    return Section("failures", {**named, "root_causes": roots, "causes": causes})


def plain_value(value: object) -> Packable:
    """Return a dataclass and its content as JSON: fields by name."""
    plain: Packable = orjson.loads(orjson.dumps(value, default=str, option=orjson.OPT_NON_STR_KEYS))
    return plain


_KINDS_WITH_PANEL: Final = frozenset({"image"})
"""Kinds of event with a panel of their own."""
_ORDER_IN_TICK: Final = {"failure": 1, "recovery": 2, "handled": 3}
"""Order of events within one tick."""


@dataclass(frozen=True, slots=True)
class ReportEvent:
    time: float
    """Time of the event, simulated s."""
    kind: str
    text: str
    node: str


def pack_events(run: Run) -> Section:
    found = report_events(run)
    if not found:
        return Section("events", {"empty": "The log holds no event."})
    words = StringTable()
    return Section(
        "events",
        {
            "time": np.array([one.time for one in found], dtype=np.float64),
            **{
                name: words.numbers([getattr(one, name) for one in found])
                for name in ("kind", "text", "node")
            },
            "words": list(words.texts),
        },
    )


def report_events(run: Run) -> tuple[ReportEvent, ...]:
    """Return the events in order of time; in one tick failures before their recoveries."""
    found = [*_events(run), *_plans(run), *_lines(run)]
    return tuple(sorted(found, key=lambda one: (one.time, _ORDER_IN_TICK.get(one.kind, 0))))


def _events(run: Run) -> Iterator[ReportEvent]:
    for at in run.events:
        event = at.record
        if event.kind not in _KINDS_WITH_PANEL:
            yield ReportEvent(at.time, event.kind, event.message, event.node)


def _plans(run: Run) -> Iterator[ReportEvent]:
    for at in run.plans:
        kind = "plan" if at.record.outcome == "found" else "no plan"
        yield ReportEvent(at.time, kind, plan_line(at.record), "")


def plan_line(plan: Plan) -> str:
    cost = f"{plan.checks} checks by {plan.planner}" if plan.planner else f"{plan.checks} checks"
    if plan.outcome == "found":
        return f"{plan.request}: {plan.duration:.2f} s of motion, {cost}"
    message = f": {plan.message}" if plan.message else ""
    return f"{plan.request}: {plan.outcome}{message} ({cost})"


def _lines(run: Run) -> Iterator[ReportEvent]:
    """Yield the log lines without an event: failures, and messages of the mission."""
    events = {(at.time, at.record.message) for at in run.events}
    for at in run.lines:
        line = at.record
        if (at.time, line.message) not in events:
            kind = "failure" if line.level in ("ERROR", "FATAL") else "log"
            yield ReportEvent(at.time, kind, line.message, line.name)


PAGE_FOLDER: Final = Path(__file__).parent / "page"
TREE_SCRIPTS: Final = ("libraries.js", "arranging.js", "viewer.js")
"""Scripts of the drawn tree; `report.js` uses their global `PicktreeDrawing`."""


def render_page(title: str, summary: str, sections: Iterable[Section]) -> str:
    """Return the complete HTML file. `summary` is displayed where scripts do not run."""
    scripts = [(svg_drawing.PAGE_FOLDER / name).read_text(encoding="utf-8") for name in TREE_SCRIPTS]
    scripts.append((PAGE_FOLDER / "report.js").read_text(encoding="utf-8"))
    template = Template((PAGE_FOLDER / "page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title),
        summary=escape(summary),
        generator=f"picktree {__version__}",
        policy=escape(_content_security_policy(scripts)),
        style=style(),
        payload=pack(sections),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
    )


def style() -> str:
    """Return the style sheet: the palette of the drawn tree as variables, then its rules and the page's
    own."""
    drawing = Template((svg_drawing.PAGE_FOLDER / "drawing.css").read_text(encoding="utf-8"))
    return "\n".join(
        (
            f":root {{ color-scheme: light; {_variables(svg_drawing.LIGHT_COLOURS)} }}",
            f':root[data-theme="dark"] {{ color-scheme: dark; {_variables(svg_drawing.DARK_COLOURS)} }}',
            drawing.substitute({name: f"var(--{name})" for name in svg_drawing.LIGHT_COLOURS}),
            (PAGE_FOLDER / "report.css").read_text(encoding="utf-8"),
        )
    )


def _variables(colours: Mapping[str, str]) -> str:
    return " ".join(f"--{name}: {value};" for name, value in colours.items())


def _content_security_policy(scripts: Iterable[str]) -> str:
    """Return a content security policy: nothing may be fetched, and only these scripts may run."""
    digests = (hashlib.sha256(script.encode("utf-8")).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode('ascii')}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src blob:; base-uri 'none'; form-action 'none'"
    )


_OUTCOME_COLOURS = {
    "success": "success", **dict.fromkeys(("paused", "interrupted", "stopped", "killed", "unknown"), "open")
}  # fmt: skip
"""Colour class of the outcome; any other outcome is a failure."""


def pack_run(run: Run) -> Section:
    explanation = run.explanation
    columns = ("time", "tick", "node", "cause", "item", "fate")
    marks: dict[str, Packable] = {
        name: [{"time": at.time, "label": at.record.message} for at in run.events if at.record.kind == kind]
        for name, kind in (("done", "item_done"), ("faults", "fault"))
    }
    return Section(
        "run",
        {
            "mission": run.info.mission,
            "remark": f"{run.info.scene} · {run.info.seed_text}",
            "outcome": _outcome(explanation.outcome),
            "facts": [[name, value] for name, value in _facts(run)],
            "notes": list(_notes(run)),
            "times": np.array(run.ticks.times, dtype=np.float64),
            "failures": [{name: getattr(f, name) for name in columns} for f in explanation.failures],
            **marks,
        },
    )


def summary(run: Run) -> str:
    outcome = run.explanation.outcome
    items = _items(outcome)
    return f"{run.info.mission}, {run.info.seed_text}: {outcome.status}" + (f", {items}" if items else "")


def _outcome(outcome: ExplainedOutcome) -> Packable:
    return {
        "word": outcome.status,
        "kind": _OUTCOME_COLOURS.get(outcome.status, "failure"),
        "sentence": outcome.sentence,
        "items": _items(outcome),
    }


def _items(outcome: ExplainedOutcome) -> str:
    if outcome.items_total is None:
        return ""
    return f"{outcome.items_sorted} of {outcome.items_total} items sorted"


def _facts(run: Run) -> list[tuple[str, str]]:
    """Return names and values, the most important ones first."""
    info, result = run.info, run.result
    rows = [
        ("Outcome", run.explanation.outcome.sentence),
        ("Mission", info.mission),
        ("Scene", info.scene),
        ("Robot", info.robot),
        ("Seed", info.seed_text.removeprefix("seed ")),
        ("Backend", info.backend),
        ("Simulated", f"{run.duration:.2f} s in {len(run.ticks)} ticks of {info.tick:g} s"),
    ]
    if info.parameters:
        rows.append(("Parameters", ", ".join(f"{name}={value}" for name, value in info.parameters.items())))
    if result is not None:
        picks = result.picks
        rows.append(("Grasps", f"{picks.held} of {picks.tried} held"))
        rows.append(("Thinking", "charged" if result.thinking_charged else "takes no simulated time"))
        rows.append(("Digest", result.digest))
    rows.append(("picktree", " ".join(filter(None, (info.versions.get("picktree", ""), info.revision)))))
    rows.append(("Log", str(run.path)))
    return rows


def _notes(run: Run) -> list[str]:
    """Return remarks that limit the reliability of the page."""
    return [run.recovered] if run.recovered else []


PACKERS: tuple[Callable[[Run], Section], ...] = (
    pack_run,
    pack_stage,
    pack_failures,
    pack_lanes,
    pack_tree,
    pack_board,
    pack_images,
    pack_events,
    pack_plots,
)
"""Packers of the panels' data; `src/panels.js` has the panels by the names of these sections."""


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """Written report: the file, its size, and the time to make it."""

    file: Path
    bytes: int
    seconds: float
    """Time to make the report, wall s."""
    simulated: float
    """Length of the run, simulated s."""

    def to_text(self) -> str:
        return (
            f"{self.file}: {self.bytes / 1e6:.1f} MB for {self.simulated:.0f} simulated s, "
            f"made in {self.seconds:.1f} s"
        )

    def to_json(self) -> dict[str, str | int | float]:
        return {
            "file": str(self.file.absolute()),
            "bytes": self.bytes,
            "seconds": round(self.seconds, 3),
            "sim_seconds": round(self.simulated, 3),
        }


def write_report(run: Run, file: Path) -> WrittenReport:
    """Write the report of `run`. Raises PicktreeError when the file cannot be written."""
    began = time.perf_counter()
    text = report(run)
    data = text.encode("utf-8")
    with file_system.whole([file], file) as (beside,):
        beside.write_bytes(data)
    return WrittenReport(file, len(data), time.perf_counter() - began, run.duration)


def report(run: Run) -> str:
    """Return the page as text. Raises PicktreeError for a log without a tick, and where it is damaged."""
    if not run.ticks.times:
        raise PicktreeError(f"{run.path}: the log holds no tick, so there is nothing to report")
    info = run.info
    title = f"{info.mission}, {info.scene}, {info.seed_text}"
    return render_page(title, summary(run), (packer(run) for packer in PACKERS))

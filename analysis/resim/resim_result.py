"""Result of a re-simulation, as text and as JSON."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...files.errors import PicktreeError
from ...logs.schema.json_records import Arithmetic, arithmetic_difference
from ...session import environment
from ...session.recipe import ROBOT_MESHES
from ...world.scene.scene_loading import load_scene
from ..compare.divergence import MessageDifference
from ..compare.divergence_text import aligned
from ..compare.run_outcome import RunOutcome
from ..run import Run


@dataclass(frozen=True, slots=True)
class Reason:
    """One changed thing, with its values; empty where there is no value."""

    what: str
    recorded: str
    now: str

    def __str__(self) -> str:
        if not (self.recorded or self.now):
            return self.what
        return f"{self.what}: {self.recorded or 'none'} then, {self.now or 'none'} now"


def reasons(run: Run, now: Arithmetic) -> tuple[Reason, ...]:
    """Return the differences, the likeliest first; empty when everything is as in the log.

    `now` is the arithmetic of the process that has run it again.
    """
    recorded = run.info.arithmetic
    departed = arithmetic_difference(recorded, now)
    return (
        *_changed_attachments(run),
        *_sources(run),
        *([Reason(departed, "", "")] if departed else []),
        *_differing_values(run.info.versions, environment.versions(run.info.versions)),
        *_modules(run),
        *_meshes(run),
        *(() if recorded else _differing_values(run.info.machine, environment.machine())),
    )


def notes(run: Run) -> tuple[str, ...]:
    """Return sentences about files that were edited on the disk. The run is made from those of the log."""
    found: list[str] = []
    for name, (digest, path) in _files(run).items():
        now = _present_hash(name, Path(path)) if path and name in run.log.attachments else None
        if now is not None and now != digest:
            found.append(f"{path} was edited since; what the log holds was run")
    return tuple(found)


def moved_sources(run: Run) -> tuple[str, ...]:
    """Return a sentence when picktree's files have other places than in the version that recorded the run."""
    try:
        before = environment.sources_from_text(run.log.attachment(environment.SOURCES_ATTACHMENT).decode())
    except PicktreeError:
        return ()
    moved = environment.moved_sources(before, environment.sources())
    return (moved,) if moved else ()


def _present_hash(name: str, path: Path) -> str | None:
    """Return the hash of today's file; None when there is no such file."""
    if name != "scene.yaml":
        return _hash(path)
    try:  # with the content of its base files
        return hashlib.sha256(load_scene(str(path)).text.encode()).hexdigest()
    except PicktreeError:
        return _hash(path)


def _changed_attachments(run: Run) -> Iterator[Reason]:
    """Yield files that have changed within the log."""
    for name, (digest, _) in _files(run).items():
        if name in run.log.attachments:
            held = hashlib.sha256(run.log.attachment(name)).hexdigest()
            if held != digest:
                yield Reason(f"{name} in the log is not what was run", "", "")


def _sources(run: Run) -> Iterator[Reason]:
    """Yield differences of picktree's sources, or of its revision when the log has no sources."""
    now = environment.sources()
    try:
        before = environment.sources_from_text(run.log.attachment(environment.SOURCES_ATTACHMENT).decode())
    except PicktreeError:
        if run.info.revision != environment.revision():
            yield Reason("revision of picktree", run.info.revision, environment.revision())
        return
    changes = environment.source_changes(before, now)
    yield from (Reason(change, "", "") for change in changes)
    if changes and run.info.revision != environment.revision():
        yield Reason("revision of picktree", run.info.revision, environment.revision())


def _modules(run: Run) -> Iterator[Reason]:
    """Yield differences of installed plug-ins, whose sources the log holds."""
    for name in run.log.attachments:
        if name.startswith("module/") and name.endswith(".py"):
            module = name.removeprefix("module/").removesuffix(".py")
            try:
                spec = importlib.util.find_spec(module)
            except (ImportError, ValueError):
                spec = None
            source = Path(spec.origin) if spec and spec.origin else None
            now = _hash(source) if source else None
            if now != hashlib.sha256(run.log.attachment(name)).hexdigest():
                yield Reason(f"the plug-in {module} is another now", "", "")


def _meshes(run: Run) -> Iterator[Reason]:
    """Yield differences of meshes of a robot from an installed package: their content is not in the log."""
    for name, (digest, path) in _files(run).items():
        if name.startswith(ROBOT_MESHES) and name not in run.log.attachments:
            now = _hash(Path(path))
            if now is not None and now != digest:
                yield Reason(f"the robot's mesh {path} is another now", "", "")


def _differing_values(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[Reason]:
    """Yield values that differ. A value that an older log lacks is no reason."""
    for name, value in before.items():
        if now.get(name, "") != value:
            yield Reason(name, value, now.get(name, ""))


def _files(run: Run) -> dict[str, tuple[str, str]]:
    """Return hash and path by the name in the log."""
    pairs = {name: words.partition(" ") for name, words in run.info.files.items()}
    return {name: (digest, path) for name, (digest, _, path) in pairs.items()}


def _hash(path: Path) -> str | None:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return None


_MAX_VALUE_LENGTH = 100
"""Maximum number of characters of a displayed value."""


@dataclass(frozen=True, slots=True)
class Resimulation:
    """Record of a run, compared with its re-simulation, which is the same except for `changes`."""

    log: Path
    recovered: str
    """Sentence when the record was not finished, else empty."""
    cut: bool
    """Whether the recorded run was cut off before its own end."""
    changes: tuple[str, ...]
    """Sentence for each intended change."""
    until: float | None
    """End of the comparison, simulated s; None: the end of the run."""
    last_tick: int
    """Number of the last compared tick of the record, 0 for its first."""
    ticks: int
    """Number of equal ticks, from the first on."""
    recorded_ticks: int
    """Number of the record's ticks within the comparison."""
    seconds: float
    """Time of the last compared tick or, with a difference, of the last equal one, simulated s."""
    digest: str
    """Digest of the equal messages, in hex."""
    exact: bool
    """Whether the messages agree in their bytes; else, as with an older log, in their values."""
    difference: MessageDifference | None
    trees: MessageDifference | None
    """First difference of the trees as they were loaded; None: they are equal."""
    reasons: tuple[Reason, ...]
    notes: tuple[str, ...]
    parting: tuple[str, ...]
    """Divergence of the two runs, as lines; only with changes."""
    outcomes: tuple[RunOutcome, RunOutcome] | None
    """Outcomes of the record and of the run; None without changes."""
    warnings: str
    """Warnings of the checker about another mission, as lines."""
    kept: Path | None
    """Path of the new log; None: it was not kept."""

    @property
    def identical(self) -> bool:
        """Whether everything happened as recorded. With changes the tree itself may differ."""
        return self.difference is None and (self.trees is None or bool(self.changes))

    def to_text(self) -> str:
        """Return the text for a terminal, without a trailing newline."""
        lines = [f"changed     {line}" for line in self.changes]
        if self.recovered:
            lines.append(f"the log     {self.recovered}")
        apart = self.difference or (None if self.changes else self.trees)
        if apart is None:
            lines.append(self._same())
        else:
            lines += difference_lines(apart)
            if apart.tick:
                lines.append(f"the {self.ticks} ticks before are the same")
            lines += self._why()
        if self.outcomes is not None:
            lines += ["", *outcome_table(*self.outcomes, "recorded", "now")]
        if self.difference is not None:
            lines += self.parting
        lines += [f"note        {note}" for note in self.notes]
        if self.kept is not None:
            lines.append(f"new log     {self.kept}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        return {
            "identical": self.identical,
            "exact": self.exact,
            "ticks": self.ticks,
            "recorded_ticks": self.recorded_ticks,
            "seconds": round(self.seconds, 6),
            "digest": self.digest,
            "log": str(self.log),
            "recovered": self.recovered,
            "cut": self.cut,
            "until": self.until,
            "changes": list(self.changes),
            "difference": difference_json(self.difference),
            "trees": difference_json(self.trees),
            "reasons": [asdict(reason) for reason in self.reasons],
            "notes": list(self.notes),
            "parting": list(self.parting),
            "new_log": None if self.kept is None else str(self.kept),
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2) + "\n"

    def _same(self) -> str:
        what = "the same" if self.changes else "identical"
        if self.cut and self.ticks == self.recorded_ticks:
            what += " up to where the recorded run was cut off"
        elif self.until is not None:
            what += f" up to tick {self.last_tick}"
        said = f"{what}: {self.ticks} ticks, {self.seconds:.2f} simulated s"
        if self.changes:
            return said
        return f"{said}, digest {self.digest[:16]}" if self.exact else f"{said}, in all that this log tells"

    def _why(self) -> Iterator[str]:
        first = "besides" if self.changes else "likely why"
        for n, reason in enumerate(self.reasons):
            yield f"{first if n == 0 else '':<10}  {reason}"
        if not self.reasons and not self.changes:
            yield "likely why  nothing in the log is otherwise: not picktree, its libraries, the arithmetic."
            yield "            What is left is a clock, the order of a set or a global generator in a"
            yield "            plug-in, or a fault of picktree"


def difference_lines(apart: MessageDifference) -> Iterator[str]:
    field = f" {apart.field}" if apart.field else ""
    of = f" ({apart.of})" if apart.of else ""
    yield f"different from tick {apart.tick} on, {apart.time:.2f} s: {apart.topic}{field}{of}"
    if apart.missing:
        only = "now" if apart.missing == "a" else "recorded"
        yield f"  there is such a message only {only}"
    elif not apart.field:
        yield "  the bytes differ, the values do not"
    else:
        recorded, now = _value_texts(apart.a, apart.b)
        yield f"  recorded  {recorded}"
        yield f"  now       {now}"


def outcome_table(a: RunOutcome, b: RunOutcome, name_a: str, name_b: str) -> Iterator[str]:
    """Yield two outcomes side by side, as lines."""
    rows = [("", name_a, name_b)]
    rows += [(what, say_a, say_b) for (what, say_a), (_, say_b) in zip(_rows(a), _rows(b), strict=True)]
    causes = sorted({*a.failures, *b.failures})
    rows += [(f"  {cause}", str(a.failures.get(cause, 0)), str(b.failures.get(cause, 0))) for cause in causes]
    yield from aligned(rows)


def _rows(outcome: RunOutcome) -> list[tuple[str, str]]:
    sorted_ = "–" if outcome.items_sorted is None else f"{outcome.items_sorted} of {outcome.items_total}"
    return [
        ("status", outcome.status),
        ("items sorted", sorted_),
        ("items done, as believed", str(outcome.items_done)),
        ("grasps held", f"{outcome.picks_held} of {outcome.picks_tried}"),
        ("simulated time", f"{outcome.end:.2f} s"),
        ("handler runs", str(outcome.recoveries)),
        ("failures", str(sum(outcome.failures.values()))),
    ]


def difference_json(apart: MessageDifference | None) -> dict[str, Any] | None:
    if apart is None:
        return None
    return {
        "tick": apart.tick,
        "time": round(apart.time, 6),
        "topic": apart.topic,
        "missing": {"": "", "a": "recorded", "b": "now"}[apart.missing],
        "field": apart.field,
        "of": apart.of,
        "recorded": apart.a,
        "now": apart.b,
    }


def _value_texts(one: object, other: object) -> tuple[str, str]:
    """Return both values as text, cut around their first difference."""
    a, b = (v if isinstance(v, str) else json.dumps(v, ensure_ascii=False, default=str) for v in (one, other))
    same = next((n for n, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    begin = max(0, same - _MAX_VALUE_LENGTH // 2) if max(len(a), len(b)) > _MAX_VALUE_LENGTH else 0
    return _cut(a, begin), _cut(b, begin)


def _cut(text: str, begin: int) -> str:
    end = begin + _MAX_VALUE_LENGTH
    return ("…" if begin else "") + text[begin:end] + ("…" if len(text) > end else "")

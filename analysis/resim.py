"""Re-simulation of a recorded run in another process with another hash seed, and its comparison with the
record.

The other process reads one order from stdin. It writes lines of JSON to stdout: its progress, and in the end
the answer.

The result is rendered as text and as JSON.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import IO, Any, cast

from pydantic import TypeAdapter

from picktree.analysis.compare import RunOutcome, align, message_differences, outcome_of, run_diff
from picktree.files import FileError, PicktreeError, fault_lines
from picktree.logs import RunResult, arithmetic_record
from picktree.session import Observer, RecordedRun, Session, arithmetic, environment, run_recipe
from picktree.world import Tick
from picktree.world.scene import load_scene

from .record_comparison import RecordComparison, difference_json, difference_lines, is_cut, outcome_table
from .run import Run
from .run_changes import RunChanges, apply_changes, parse_tick


@dataclass(frozen=True, slots=True)
class Reason:
    """Difference between recorded and present state, with both values; empty: no value."""

    what: str
    recorded: str
    now: str

    def __str__(self) -> str:
        if not (self.recorded or self.now):
            return self.what
        return f"{self.what}: {self.recorded or 'none'} then, {self.now or 'none'} now"


def reasons(run: Run, now: arithmetic_record.Arithmetic) -> tuple[Reason, ...]:
    """Return the differences, the likeliest first; empty when everything is as in the log.

    `now` is the arithmetic of the process that has run it again.
    """
    recorded = run.info.arithmetic
    departed = arithmetic_record.arithmetic_difference(recorded, now)
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
            found.append(f"{path} was edited after the run; the version in the log was run")
    return tuple(found)


def moved_sources(run: Run) -> tuple[str, ...]:
    """Return a sentence when picktree's files have other places than in the version that recorded the run."""
    before = _recorded_sources(run)
    moved = "" if before is None else environment.moved_sources(before, environment.sources())
    return (moved,) if moved else ()


def _recorded_sources(run: Run) -> dict[str, str] | None:
    """Return the hashes of picktree's sources in the log; None when it has none."""
    try:
        return environment.sources_from_text(run.log.attachment(environment.SOURCES_ATTACHMENT).decode())
    except PicktreeError:
        return None


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
                yield Reason(f"{name} in the log differs from the version that was run", "", "")


def _sources(run: Run) -> Iterator[Reason]:
    """Yield differences of picktree's sources, or of its revision when the log has no sources."""
    before = _recorded_sources(run)
    changes = () if before is None else environment.source_changes(before, environment.sources())
    yield from (Reason(change, "", "") for change in changes)
    if (changes or before is None) and run.info.revision != environment.revision():
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
                yield Reason(f"the plug-in {module} has changed since", "", "")


def _meshes(run: Run) -> Iterator[Reason]:
    """Yield differences of meshes of a robot from an installed package: their content is not in the log."""
    for name, (digest, path) in _files(run).items():
        if name.startswith(run_recipe.ROBOT_MESHES) and name not in run.log.attachments:
            now = _hash(Path(path))
            if now is not None and now != digest:
                yield Reason(f"the robot's mesh {path} has changed since", "", "")


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
    """Whether the log has all messages that the comparison covers."""
    difference: message_differences.MessageDifference | None
    trees: message_differences.MessageDifference | None
    """First difference of the loaded trees; None: they are equal."""
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
                lines.append(f"the {self.ticks} earlier ticks are the same")
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
        text = f"{what}: {self.ticks} ticks, {self.seconds:.2f} simulated s"
        if self.changes:
            return text
        return f"{text}, digest {self.digest[:16]}" if self.exact else f"{text}, as far as this log shows"

    def _why(self) -> Iterator[str]:
        first = "besides" if self.changes else "likely why"
        for n, reason in enumerate(self.reasons):
            yield f"{first if n == 0 else '':<10}  {reason}"
        if not self.reasons and not self.changes:
            yield "likely why  unknown: picktree, its libraries and the arithmetic are those of the log."
            yield "            Possible causes: a clock, the order of a set or a global generator in a"
            yield "            plug-in, or a fault of picktree"


_PROGRESS_PERIOD = 0.2
"""Wall seconds between two messages about the progress."""


@dataclass(frozen=True)
class ResimOrder:
    log: Path
    changes: RunChanges
    until: float | None
    """End of the comparison, simulated s; None: the end of the record."""
    out: Path | None
    """Folder for the run's folder; None: its log is not kept."""


@dataclass(frozen=True)
class ResimAnswer:
    """Line of the process: `at` during the run, `error` when the input is bad, else the comparison."""

    at: float | None = None
    """Progress, simulated s; None: no progress message."""
    error: str = ""
    ticks: int = 0
    digest: str = ""
    exact: bool = True
    difference: message_differences.MessageDifference | None = None
    trees: message_differences.MessageDifference | None = None
    result: str = ""
    """Result of the run as JSON text."""
    told: tuple[str, ...] = field(default_factory=tuple[str, ...])
    """Sentences about the changes."""
    warnings: str = ""
    """Warnings of the checker about another mission, as lines."""
    arithmetic: Mapping[str, str] = field(default_factory=dict[str, str])
    """Arithmetic of the process, as `Arithmetic.words`."""


ORDER = TypeAdapter(ResimOrder)
ANSWER = TypeAdapter(ResimAnswer)


class _Progress(Observer):
    """Observer that reports the progress of the run."""

    def __init__(self, say: Callable[[ResimAnswer], None]) -> None:
        self._say = say
        self._said = 0.0

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        wall = time.monotonic()
        if wall - self._said >= _PROGRESS_PERIOD:
            self._said = wall
            self._say(ResimAnswer(at=now))


def run_order(order: ResimOrder, say: Callable[[ResimAnswer], None]) -> ResimAnswer:
    """Run the order and return the comparison. Raises PicktreeError for a log that cannot be run again."""
    with (
        Run(order.log) as run,
        RecordedRun(run) as recorded,
        tempfile.TemporaryDirectory(prefix="picktree-") as away,
    ):
        changed = apply_changes(order.changes, recorded.recipe())
        recipe = changed.recipe
        comparison = RecordComparison(
            run,
            order.until,
            order.changes.settings if order.changes else None,
            stop_at_difference=not order.changes,
        )
        limit = recipe.limit if comparison.until is None else min(recipe.limit, comparison.until)
        edits = () if order.changes.mission else (recorded.edits(),)
        result = Session(
            replace(recipe, limit=limit),
            record=run_recipe.Recording(order.out or Path(away)),
            observers=(_Progress(say), comparison, recorded.operator(), *edits),
        ).run()
        comparison.finish()
        return ResimAnswer(
            ticks=comparison.ticks,
            digest=comparison.digest,
            exact=comparison.exact,
            difference=comparison.difference,
            trees=comparison.trees,
            result=result.to_json_text(),
            told=changed.told,
            warnings=fault_lines(changed.warnings) if changed.warnings else "",
            arithmetic=arithmetic().words(),
        )


def main() -> int:
    # The libraries in C++ print on their own: stdout is for the answers alone.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def say(answer: ResimAnswer) -> None:
        answers.write(ANSWER.dump_json(answer).decode() + "\n")
        answers.flush()

    try:
        say(run_order(ORDER.validate_json(sys.stdin.buffer.read()), say))
    except FileError as error:
        say(ResimAnswer(error=fault_lines(error.faults)))
    except PicktreeError as error:
        say(ResimAnswer(error=str(error)))
    except (KeyboardInterrupt, BrokenPipeError):
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())

_TERMINATION_TIMEOUT = 10.0
"""Wall seconds that the other process has to finish after an interrupt."""


def resimulate(
    where: str | Path,
    *,
    changes: RunChanges | None = None,
    until: str | None = None,
    out: Path | None = None,
    progress: Callable[[float, float], None] = lambda now, end: None,
) -> Resimulation:
    """Run a logged run again from its log alone, and compare the runs message by message.

    `until`: a tick or a time (see `parse_tick`); `progress` receives the simulated time, and the time at
    which the record ends. Without changes it ends at the first difference. Raises PicktreeError.
    """
    changes = changes or RunChanges()
    with Run(where) as run, tempfile.TemporaryDirectory(prefix="picktree-") as away:
        times = run.ticks.times
        if not times:
            raise PicktreeError(f"{run.path}: the log holds no tick: there is nothing to run again")
        run.log.require_repeatable()
        last = parse_tick(until, run, "--until") if until else None
        limit = RecordComparison(run, None if last is None else times[last]).until
        keep = out if out is not None or not changes else Path(away)
        order = ResimOrder(run.path.absolute(), changes, None if last is None else times[last], keep)
        answer = _run_in_process(order, lambda now: progress(now, times[-1] if limit is None else limit))
        result = RunResult.from_json_text(answer.result, run.path)
        first = 1 if run.info.continues else 0  # the tick of the checkpoint is no tick of this run
        count = (len(times) if limit is None else run.ticks.number_at(limit) + 1) - first
        found = Resimulation(
            log=run.path.absolute(),
            recovered=run.recovered,
            cut=is_cut(run),
            changes=answer.told,
            until=limit,
            last_tick=first + count - 1,
            ticks=answer.ticks,
            recorded_ticks=count,
            seconds=times[first + min(answer.ticks, count) - 1] if answer.ticks else times[0],
            digest=answer.digest,
            exact=answer.exact,
            difference=answer.difference,
            trees=answer.trees,
            reasons=(
                reasons(run, arithmetic_record.Arithmetic.from_words(answer.arithmetic))
                if answer.difference or answer.trees
                else ()
            ),
            # Where it differs, the reasons have it.
            notes=(*notes(run), *(() if answer.difference or answer.trees else moved_sources(run))),
            parting=(),
            outcomes=None,
            warnings=answer.warnings,
            kept=result.log if out is not None else None,
        )
        return _with_outcomes(found, run, result.log) if changes else found


def _with_outcomes(found: Resimulation, run: Run, log: Path) -> Resimulation:
    with Run(log) as other:
        parting = align(run, other).parting
        lines = () if parting is None else tuple(run_diff.parting_lines(parting))
        return replace(found, parting=lines, outcomes=(outcome_of(run), outcome_of(other)))


def _run_in_process(order: ResimOrder, progress: Callable[[float], None]) -> ResimAnswer:
    """Have the other process carry out the order, and return its answer."""
    environment = {**os.environ, "PYTHONHASHSEED": "random"}
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree.analysis.resim"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    )
    answer: ResimAnswer | None = None
    try:
        order_stream, answers = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
        with order_stream:
            order_stream.write(ORDER.dump_json(order))
        for line in answers:
            answer = ANSWER.validate_json(line)
            if answer.at is not None:
                progress(answer.at)
        process.wait()
    except BaseException:
        _end_process(process)
        raise
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode != 0 or answer is None or answer.at is not None:
        raise RuntimeError(f"the process for the repeated run ended with exit code {process.returncode}")
    if answer.error:
        raise PicktreeError(answer.error)
    return answer


def _end_process(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(_TERMINATION_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

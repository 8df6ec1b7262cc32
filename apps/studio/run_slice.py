"""Run slice: the table of runs, and the calls with which the page opens, explains, continues and compares
them.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import re
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any, Final, cast

import orjson
from pydantic import Field
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from picktree import __version__
from picktree.files import PicktreeError
from picktree.logs import RunLog, install_command, log_files, run_index

from .calls import JsonValue, call, watch
from .jobs import Job, command_answer, job_text
from .security import SANDBOXED
from .slice import Slice, Studio
from .workspace import Workspace

SORT_COLUMNS: Final[Mapping[str, Callable[[run_index.RunRow], Any]]] = {
    "written": lambda row: row.written,
    "status": lambda row: row.status,
    "mission": lambda row: row.mission.lower() or None,
    "scene": lambda row: row.scene.lower() or None,
    "seed": lambda row: row.seed,
    "units_an_hour": lambda row: row.units_an_hour,
    "mtbf": lambda row: row.mtbf,
    "sorted": lambda row: None if row.sorted is None or not row.total else row.sorted / row.total,
    "lost": lambda row: row.lost,
    "seconds": lambda row: row.seconds,
    "cause": lambda row: row.cause or None,
    "folder": lambda row: row.folder,
}
"""Columns to sort by; rows without a value come last."""
_FIRST_SHOWN: Final = 0.2
"""Interval between displays during the first look at many runs, wall s. It grows by a tenth."""
_MIN_PERIOD: Final = 1.0
_LOOK_INTERVAL_RATIO: Final = 20
"""Wall time between two looks, as a multiple of the time that a look takes."""


@dataclass(frozen=True, slots=True)
class Query:
    """Query of the table. `where`: condition as of `picktree runs --where`; `text`: words to be found."""

    where: str = ""
    text: str = ""
    sort: str = "written"
    descending: bool = True


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of the table at one moment."""

    version: int
    rows: tuple[run_index.RunRow, ...]
    complete: bool
    """Whether all logs have been looked at once."""


class RunTable:
    """Rows of all runs. `look` is repeated while there are watchers."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._index: run_index.RunIndex | None = None
        self._lock = threading.Lock()
        self.snapshot = Snapshot(0, (), False)
        self._words: dict[int, tuple[run_index.RunRow, str]] = {}
        self._answers: dict[Query, tuple[int, tuple[run_index.RunRow, ...]]] = {}
        self._watchers = 0
        self._looking: asyncio.Task[None] | None = None
        self.problem = ""
        """Reason why the runs cannot be listed; empty when they can."""

    @property
    def folder(self) -> Path:
        """Folder whose runs are listed: `runs` below the studio's folder, or that folder without one."""
        below = self._workspace.root / log_files.RUNS_FOLDER
        if below.is_symlink() or below.is_dir():
            return self._workspace.resolve(str(log_files.RUNS_FOLDER))
        return self._workspace.root

    def run_id(self, row: run_index.RunRow) -> str:
        """Return the identity of a run in the page: its path below the studio's folder."""
        index = self._index
        return row.folder if index is None else self._workspace.relative(index.folder / row.folder)

    def enter(self) -> None:
        """Count a watcher; with the first one, begin to look."""
        self._watchers += 1
        if self._looking is None or self._looking.done():
            self._looking = asyncio.get_running_loop().create_task(self._look_again())

    def leave(self) -> None:
        """Subtract a watcher."""
        self._watchers -= 1

    async def close(self) -> None:
        """Stop looking."""
        if self._looking is not None:
            self._looking.cancel()
            with suppress(asyncio.CancelledError):
                await self._looking

    async def _look_again(self) -> None:
        while self._watchers:
            began = time.monotonic()
            await asyncio.to_thread(self.look)
            spent = time.monotonic() - began
            await asyncio.sleep(max(_MIN_PERIOD, _LOOK_INTERVAL_RATIO * spent))

    def look(self) -> None:
        """Look at all runs once. During the first look, the rows found so far are shown."""
        with self._lock:
            try:
                folder = self.folder
                if self._index is None or self._index.folder != folder:
                    self._index = run_index.RunIndex(folder)
            except PicktreeError as error:
                self.problem = str(error)
                self._show((), complete=True)
                return
            self.problem = ""
            rows: list[run_index.RunRow] = []
            shown = time.monotonic()
            pause = _FIRST_SHOWN
            for row in self._index.rows():
                if not rows:  # what is in the cache has been read by now
                    shown = time.monotonic()
                rows.append(row)
                self._text(row)
                if not self.snapshot.complete and time.monotonic() - shown > pause:
                    shown, pause = time.monotonic(), 1.1 * pause
                    self._show(tuple(rows), complete=False)
            self._show(tuple(rows), complete=True)

    def _show(self, rows: tuple[run_index.RunRow, ...], *, complete: bool) -> None:
        before = self.snapshot
        if rows != before.rows or complete != before.complete:
            self.snapshot = Snapshot(before.version + 1, rows, complete)

    def select(self, query: Query) -> tuple[run_index.RunRow, ...]:
        """Return the rows that a query finds, sorted. Raises PicktreeError for a bad condition or column."""
        snapshot = self.snapshot
        found = self._answers.get(query)
        if found is not None and found[0] == snapshot.version:
            return found[1]
        if query.sort not in SORT_COLUMNS:
            raise PicktreeError(f"there is no column {query.sort!r}; sort by {', '.join(SORT_COLUMNS)}")
        rows: Sequence[run_index.RunRow] = snapshot.rows
        words = query.text.lower().split()
        if words:
            rows = [row for row in rows if all(word in self._text(row) for word in words)]
        if query.where.strip():
            condition, now = run_index.RunFilter.parse(query.where), time.time()
            rows = [row for row in rows if condition(row, now)]
        key = cast("Callable[[run_index.RunRow], Any]", SORT_COLUMNS[query.sort])
        known = sorted((row for row in rows if key(row) is not None), key=key, reverse=query.descending)
        answer = (*known, *(row for row in rows if key(row) is None))
        if len(self._answers) > 50:
            self._answers.clear()
        self._answers[query] = (snapshot.version, answer)
        return answer

    def _text(self, row: run_index.RunRow) -> str:
        known = self._words.get(id(row))
        if known is None or known[0] is not row:
            parts = (row.status, row.mission, row.scene, row.robot, row.backend, row.folder, *row.causes)
            known = (row, " ".join((*parts, f"seed {row.seed}")).lower())
            if len(self._words) > 4 * len(self.snapshot.rows) + 20_000:
                self._words.clear()
            self._words[id(row)] = known
        return known[1]


MAX_KEPT: Final = 400_000_000
"""Size of all kept files, bytes. Beyond it those that were used longest ago are deleted."""
COMMAND_TIMEOUT: Final = 900.0
"""Time limit of a command, wall s."""
_MAX_COMMANDS: Final = 2
"""Maximum number of concurrent commands for such files."""


class MadeFiles:
    """Folder of generated files, by their inputs. It may be deleted at any time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._making: dict[Path, asyncio.Task[None]] = {}
        self._slots = asyncio.Semaphore(_MAX_COMMANDS)

    def place(self, log: Path, kind: str) -> Path:
        """Return the path of a generated file (`report.html`, `explain.json`) for the present content of a
        log.

        Raises PicktreeError when the log is gone.
        """
        try:
            stamps = [path.stat() for path in (log, *log_files.part_paths(log).values())]
        except OSError as error:
            raise PicktreeError(f"{log} cannot be read: {(error.strerror or str(error)).lower()}") from None
        parts = [__version__, str(log), *(f"{each.st_size} {each.st_mtime_ns}" for each in stamps)]
        name = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
        return self._folder / f"{name}-{kind}"

    async def made(self, log: Path, kind: str, command: Sequence[str]) -> Path:
        """Return the file, made by a command of picktree when it is not there. `{}` in it is the file.

        A command that writes to stdout, and names no `{}`, has its stdout put into the file. Raises
        PicktreeError with what the command said when it failed.
        """
        place = self.place(log, kind)
        if not place.exists():
            task = self._making.get(place)
            if task is None:
                task = asyncio.get_running_loop().create_task(self._make(place, command))
                self._making[place] = task
                task.add_done_callback(lambda _: self._making.pop(place, None))
            await asyncio.shield(task)
        with suppress(OSError):
            os.utime(place)
        return place

    async def _make(self, place: Path, command: Sequence[str]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        beside = place.with_name(f"making-{os.getpid()}-{place.name}")
        words = [word.replace("{}", str(beside)) for word in command]
        try:
            async with self._slots:
                out = await command_answer(words, COMMAND_TIMEOUT)
        except PicktreeError:
            beside.unlink(missing_ok=True)
            raise
        if words == list(command):
            beside.write_bytes(out)
        beside.replace(place)
        self._delete_old()

    def _delete_old(self) -> None:
        files = [(file, file.stat()) for file in self._folder.iterdir()]
        files.sort(key=lambda each: each[1].st_mtime, reverse=True)
        total = 0
        for file, stamp in files:
            total += stamp.st_size
            if total > MAX_KEPT:
                file.unlink(missing_ok=True)

    async def close(self) -> None:
        """Stop the running commands."""
        tasks = list(self._making.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


MAX_WINDOW: Final = 500
"""Number of rows that one call returns at most."""
_PERIOD: Final = 0.2
_WHATIF: Final = "runs.whatif"
"""Name of the finisher of a what-if's job."""
_NEW_LOG: Final = re.compile(r"^new log +(.+)$", re.MULTILINE)
Count = Annotated[int, Field(ge=0, le=MAX_WINDOW)]
Moment = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class RunSlice(Slice):
    """Calls on the runs of the folder."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._jobs = studio.jobs
        self._jobs.finishers[_WHATIF] = self._find_new_run
        self._table = RunTable(studio.workspace)
        self._made = MadeFiles(studio.workspace.state.place / "made")

    def routes(self) -> Sequence[BaseRoute]:
        return (Route("/runs/{id:path}/report", self._report_page),)

    async def close(self) -> None:
        await self._table.close()
        await self._made.close()

    @watch("runs.index")
    async def index(
        self,
        where: str = "",
        text: str = "",
        sort: str = "written",
        descending: bool = True,
        count: Count = 100,
    ) -> AsyncIterator[JsonValue]:
        """Yield the number of runs and the first rows, again whenever they change."""
        query, last = Query(where, text, sort, descending), None
        self._table.enter()
        try:
            while True:
                snapshot = self._table.snapshot
                if last != snapshot.version and (snapshot.rows or snapshot.complete):
                    last = snapshot.version
                    rows = await asyncio.to_thread(self._table.select, query)
                    yield {
                        "version": last,
                        "total": len(snapshot.rows),
                        "matched": len(rows),
                        "complete": snapshot.complete,
                        "problem": self._table.problem,
                        "rows": [self._row(row) for row in rows[:count]],
                    }
                await asyncio.sleep(_PERIOD if last else 0.02)
        finally:
            self._table.leave()

    @call("runs.rows")
    async def rows(
        self,
        where: str = "",
        text: str = "",
        sort: str = "written",
        descending: bool = True,
        offset: Annotated[int, Field(ge=0)] = 0,
        count: Count = 100,
    ) -> JsonValue:
        """Return a window of the rows that a query finds."""
        rows = await asyncio.to_thread(self._table.select, Query(where, text, sort, descending))
        return [self._row(row) for row in rows[offset : offset + count]]

    @call("runs.columns")
    async def columns(self) -> JsonValue:
        """Return the names of a condition with their meanings."""
        return {name: meaning for name, (_, meaning) in run_index.COLUMNS.items()}

    def _row(self, row: run_index.RunRow) -> dict[str, JsonValue]:
        return cast("dict[str, JsonValue]", {**row.to_json(), "id": self._table.run_id(row)})

    def log_of(self, id: str) -> Path:
        """Return the log of a run by its identity. Raises PicktreeError when none is below the folder."""
        log = log_files.find_log(self._workspace.resolve(id))
        place = self._workspace.resolve(self._workspace.relative(log))
        if not place.is_file():  # a pipe would be waited for
            raise PicktreeError(f"{id} is not a file of a log")
        return place

    @call("runs.open")
    async def open(self, id: str) -> JsonValue:
        """Return the row of a run, and the texts of its recipe."""
        return await asyncio.to_thread(self._opened, id)

    def _opened(self, id: str) -> JsonValue:
        log = self.log_of(id)
        row = run_index.RunIndex(log.parent).row(log.name)
        opened = cast("dict[str, JsonValue]", row.to_json())
        opened.update(id=id, folder=id, log=self._workspace.relative(log))
        with suppress(PicktreeError), RunLog(log) as read:
            names = read.attachments
            opened["checkpoints"] = sum(name.startswith("checkpoint") for name in names)
            opened["parameters"] = dict(read.run.parameters)
            for name in ("mission", "faults"):
                if f"{name}.yaml" in names:
                    opened[f"{name}_text"] = read.attachment(f"{name}.yaml").decode("utf-8", "replace")
            opened["mission_file"] = self._mission_file(read.run.files, read.run.mission)
        return opened

    def _mission_file(self, files: Mapping[str, str], name: str) -> str:
        """Return the path of the run's mission below the folder; empty when it is not there."""
        _, _, recorded = files.get("mission.yaml", "").partition(" ")
        with suppress(PicktreeError, ValueError):
            path = PurePath(recorded)
            below = path.relative_to(self._workspace.root) if path.is_absolute() else path
            if self._workspace.resolve(str(below)).is_file():
                return below.as_posix()
        return next((each.path for each in self._workspace.files("mission") if each.name == name), "")

    @call("runs.explain")
    async def explain(self, id: str, without_truth: bool = False) -> JsonValue:
        """Return the explanation of a run, as `picktree explain --json` prints it."""
        log = self.log_of(id)
        option, name = (["--without-truth"], "explain-seen.json") if without_truth else ([], "explain.json")
        file = await self._made.made(log, name, ["explain", str(log), "--json", *option])
        return orjson.loads(await asyncio.to_thread(file.read_bytes))

    @call("runs.report")
    async def report(self, id: str) -> str:
        """Make the report of a run, unless it is there; return its address."""
        await self._report(id)
        return f"/runs/{id}/report"

    async def _report(self, id: str) -> Path:
        log = self.log_of(id)
        return await self._made.made(log, "report.html", ["report", str(log), "-o", "{}"])

    async def _report_page(self, request: Request) -> Response:
        try:
            file = await self._report(request.path_params["id"])
        except PicktreeError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return FileResponse(file, headers={"content-security-policy": SANDBOXED})

    @call("runs.whatif")
    async def whatif(
        self,
        id: str,
        at: Moment,
        mission: str | None = None,
        mission_file: str = "",
        faults: str | None = None,
        no_faults: bool = False,
    ) -> int:
        """Resume from the checkpoint before a moment with other texts; return the job's number.

        `mission_file`: mission of the folder in place of the run's; `mission` is then an edit of it. The
        texts are written as files next to the mission, so that the files they name are found.
        """
        command = ["whatif", str(self.log_of(id)), "--at", f"{at:.4f}s", "--out", str(self._runs())]
        opened = await asyncio.to_thread(self._opened, id)
        assert isinstance(opened, dict)
        own = mission_file or opened.get("mission_file") or f"{_stem(opened.get('mission'))}.yaml"
        beside = PurePath(str(own))
        if mission_file and mission is None:
            command += ["--mission", str(self._workspace.resolve(mission_file))]
        for option, text in (("mission", mission), ("faults", faults)):
            if text is not None:
                path = beside.with_name(
                    f"{beside.stem}.what-if{'.faults' if option == 'faults' else ''}.yaml"
                )
                place = await asyncio.to_thread(self._write_over, path.as_posix(), text)
                command += [f"--{option}", str(place)]
        if no_faults:
            command.append("--no-faults")
        return self._jobs.start(f"What-if from {at:.2f} s", command, finish=_WHATIF).number

    def _write_over(self, path: str, text: str) -> Path:
        """Write a text that the studio itself makes for a command."""
        version = self._workspace.read(path).version if self._workspace.resolve(path).exists() else None
        self._workspace.write(path, text, version)
        return self._workspace.resolve(path)

    def _runs(self) -> Path:
        root, folder = self._workspace.root, self._table.folder
        holds_runs = folder != root or any(root.glob("*/*.mcap")) or any(root.glob("*.mcap"))
        return folder if holds_runs else root / "runs"

    def _find_new_run(self, job: Job) -> None:
        found = _NEW_LOG.search(job_text(job))
        if found is not None:
            with suppress(PicktreeError, ValueError):
                place = (self._workspace.root / found[1].strip()).resolve()
                job.result = f"#/run/{self._workspace.relative(place.parent)}"

    @call("runs.resim")
    async def resim(self, id: str) -> int:
        """Run a log again and compare; return the job's number."""
        return self._jobs.start(f"Run again: {id}", ["resim", str(self.log_of(id))]).number

    @call("runs.diff")
    async def diff(self, id: str, other: str) -> int:
        """Compare two runs; return the job's number."""
        command = ["diff", str(self.log_of(id)), str(self.log_of(other))]
        return self._jobs.start("Compare two runs", command).number

    @call("runs.write_report")
    async def write_report(self, id: str) -> int:
        """Write the report of a run into the folder `reports`; return the job's number."""
        path = self._new_file(f"reports/{_stem(id)}.html")
        command = ["report", str(self.log_of(id)), "-o", str(path)]
        return self._made_job("Write the page", command, path)

    @call("runs.write_film")
    async def write_film(self, id: str, start: Moment | None = None, end: Moment | None = None) -> int:
        """Write a film of a run into the folder `films`; return the job's number."""
        try:
            import av  # pyright: ignore[reportUnusedImport]  # noqa: F401
        except ImportError:
            raise PicktreeError(f"A film needs the extra 'video': {install_command('video')}") from None
        path = self._new_file(f"films/{_stem(id)}.mp4")
        command = ["video", str(self.log_of(id)), "-o", str(path)]
        command += [] if start is None else ["--from", f"{start:.3f}"]
        command += [] if end is None else ["--to", f"{end:.3f}"]
        return self._made_job("Make the film", command, path)

    def _made_job(self, title: str, command: list[str], path: Path) -> int:
        address = f"/files/{self._workspace.relative(path)}"
        return self._jobs.start(title, command, result=address).number

    def _new_file(self, path: str) -> Path:
        """Return the path of a new file, in a folder that is created if missing."""
        place = self._workspace.resolve(path)
        try:
            place.parent.mkdir(exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise PicktreeError(f"{path} cannot be written: {reason}") from None
        return place


def _stem(id: object) -> str:
    """Return a name for files of a run."""
    return re.sub(r"[^\w.-]+", "-", PurePath(str(id)).name).strip(".-")[:120] or "run"

"""Batch slice: plans with their matrix and cost, batches that are started, watched, stopped, compared."""

from __future__ import annotations

import asyncio
import fcntl
import os
import re
import signal
import sqlite3
import time
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from pathlib import Path, PurePath
from typing import Annotated, Any, Final, Literal, TypeAlias, cast

import orjson
from pydantic import Field

from picktree.files import PicktreeError
from picktree.files.yaml import YamlNode, read

from .calls import JsonValue, call, watch
from .jobs import Job, command_answer, job_text
from .slice import Slice, Studio
from .workspace import Workspace

PLAN_FILE: Final = "plan.json"
RESULTS_FILE: Final = "results.sqlite"
LOCK_FILE: Final = "lock"
MAX_JOBS: Final = 2_000
"""Number of jobs that are shown one by one, the first ones of the plan."""
MAX_BATCHES: Final = 500
Behind: TypeAlias = Literal["all", "status", "cause", "root", "place", "form", "colour"]
_JOB: Final = (
    "jobs.job, jobs.number, variant AS label, seed, status, items_sorted AS sorted, items_total AS items, "
    "sim_seconds AS seconds, look_at, folder"
)
_CONDITIONS: Final[Mapping[Behind, str]] = {
    "all": "1",
    "status": "status = :value",
    "root": "root_cause = :value",
    "cause": "job IN (SELECT job FROM failures WHERE cause = :value)",
    "form": "job IN (SELECT job FROM items WHERE form = :value AND verdict IN ('left', 'misplaced'))",
    "colour": "job IN (SELECT job FROM items WHERE colour = :value AND verdict IN ('left', 'misplaced'))",
    "place": (
        "job IN (SELECT job FROM items WHERE verdict IN ('left', 'misplaced') "
        "AND x >= :x - 1e-9 AND x < :x + :side - 1e-9 AND y >= :y - 1e-9 AND y < :y + :side - 1e-9)"
    ),
}
CELL_SIDE: Final = 0.05
"""Side of a cell of the table in summaries, m."""


def batch_folders(workspace: Workspace) -> list[Path]:
    """Return the batches in the folder and in folders of it, such as `runs`; links are not followed."""
    found: list[Path] = []
    todo = [(workspace.root, 0)]
    while todo and len(found) < MAX_BATCHES:
        folder, depth = todo.pop()
        if (folder / PLAN_FILE).is_file():
            found.append(folder)
            continue
        with suppress(OSError), os.scandir(folder) as entries:
            below = [
                e
                for e in entries
                if depth < 2 and not e.name.startswith(".") and e.is_dir(follow_symlinks=False)
            ]
            todo += [(Path(entry.path), depth + 1) for entry in below]
    return found


class BatchFolder:
    """Batch in its folder. Only the commands that run it write into the folder."""

    def __init__(self, place: Path) -> None:
        """Take a folder. Raises PicktreeError when it holds no batch."""
        self.place = place
        if not (place / PLAN_FILE).is_file():
            raise PicktreeError(f"{place.name} is not a batch: there is no {PLAN_FILE} in this folder")

    def plan(self) -> Mapping[str, Any]:
        """Return the recorded plan. Raises PicktreeError when it cannot be read."""
        try:
            plan: object = orjson.loads((self.place / PLAN_FILE).read_bytes())
        except (OSError, orjson.JSONDecodeError) as error:
            raise PicktreeError(f"{self.place.name}/{PLAN_FILE} cannot be read: {error}") from None
        if not isinstance(plan, dict):
            raise PicktreeError(f"{self.place.name}/{PLAN_FILE} is not a valid plan of a batch")
        return cast("Mapping[str, Any]", plan)

    def stamp(self) -> tuple[object, ...]:
        """Return a stamp that changes when results are recorded, or the process begins or ends."""
        stamps: list[object] = [self.runner()]
        for name in (RESULTS_FILE, f"{RESULTS_FILE}-wal"):
            with suppress(OSError):
                stat = (self.place / name).stat()
                stamps += [stat.st_size, stat.st_mtime_ns]
        return tuple(stamps)

    def runner(self) -> int | None:
        """Return the number of the process that runs the batch; None without one."""
        try:
            lock = os.open(self.place / LOCK_FILE, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            with suppress(ValueError):
                return int(os.read(lock, 20) or b"0")
            return 0
        finally:
            os.close(lock)
        return None

    def stop(self, *, now: bool) -> None:
        """Let the running jobs finish, or (`now`) break them off. Raises PicktreeError when none runs it."""
        process = self.runner()
        if process is None:
            raise PicktreeError("no process runs this batch")
        if not _is_batch(process):
            raise PicktreeError("the process that runs this batch is ending")
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGTERM if now else signal.SIGINT)

    def progress(self) -> dict[str, JsonValue]:
        """Return counts by status, and the state of each job in the order of the plan."""
        plan = self.plan()
        counts = dict(self._rows("SELECT status, count(*) FROM jobs GROUP BY status"))
        total = sum(counts.values())
        done = total - counts.get("waiting", 0)
        jobs: list[JsonValue] = [
            {"number": number, "label": label, "seed": seed, "status": status}
            for number, label, seed, status in self._rows(
                f"SELECT number, variant, seed, status FROM jobs ORDER BY number LIMIT {MAX_JOBS}"
            )
        ]
        ((seconds,),) = self._rows("SELECT avg(cpu_seconds) FROM jobs WHERE status <> 'waiting'") or [(None,)]
        return {
            "name": plan.get("name", self.place.name),
            "backend": plan.get("backend"),
            "keep": plan.get("keep"),
            "running": self.runner() is not None,
            "total": total,
            "done": done,
            "success": counts.get("success", 0),
            "counts": counts,
            "jobs": jobs,
            "cpu_seconds_a_job": seconds,
        }

    def jobs_behind(self, what: Behind, value: str, label: str) -> list[dict[str, JsonValue]]:
        """Return the jobs that a figure counts; `label`: of one recipe, or of all (empty).

        Raises PicktreeError for an invalid place.
        """
        values: dict[str, object] = {"value": value, "label": label, "side": CELL_SIDE}
        if what == "place":
            try:
                values["x"], values["y"] = map(float, value.split())
            except ValueError:
                raise PicktreeError(f"{value!r} is not a place on the table: write x and y, m") from None
        recipe = " AND variant = :label" if label else ""
        rows = self._rows(
            f"SELECT {_JOB} FROM jobs WHERE status <> 'waiting' AND {_CONDITIONS[what]}{recipe} "
            f"ORDER BY status = 'success', number LIMIT {MAX_JOBS}",
            values,
        )
        return [{name: row[name] for name in row.keys()} for row in rows]  # noqa: SIM118

    def _rows(self, sql: str, values: Mapping[str, object] | None = None) -> list[Any]:
        path = self.place / RESULTS_FILE
        if not path.is_file():
            return []  # it is being made
        try:
            with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as connection:
                connection.row_factory = sqlite3.Row
                return list(connection.execute(sql, dict(values or {})))
        except sqlite3.Error as error:
            raise PicktreeError(f"{self.place.name}/{RESULTS_FILE} cannot be read: {error}") from None


def _is_batch(process: int) -> bool:
    """Whether a process is a command on batches, as far as the system tells."""
    try:
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return process > 0 and not Path("/proc/self").exists()
    return b"batch" in words


def newest_first(folders: list[Path]) -> Iterator[BatchFolder]:
    """Yield the batches, the last written one first."""

    def written(folder: Path) -> float:
        with suppress(OSError):
            return (folder / RESULTS_FILE).stat().st_mtime
        return 0.0

    for folder in sorted(folders, key=written, reverse=True):
        with suppress(PicktreeError):
            yield BatchFolder(folder)


KEYS: Final = (
    *("name", "missions", "scenes", "robots", "faults", "seeds", "set"),
    *("backend", "verify", "limit", "wall_limit", "memory", "disk", "keep"),
)
"""Keys of a plan in the order in which the form writes new ones."""
_PLAIN: Final = re.compile(r"[A-Za-z_][\w./ -]*|\d+:\d+")
_WORDS: Final = frozenset({"true", "false", "null", "yes", "no", "on", "off"})


def form_of(text: str) -> Mapping[str, JsonValue]:
    """Return the keys of a plan with their values. Raises FileError for a text that is no YAML."""
    value = read(text, "plan").root.value
    entries = value if isinstance(value, dict) else {}
    return {key: entries[key] for key in KEYS if key in entries}  # type: ignore[misc]


def with_key(text: str, key: str, value: JsonValue) -> str:
    """Return the text with one key changed; None takes it out. All other lines are unchanged.

    Raises FileError for a text that is no YAML, PicktreeError for one whose keys are not on separate lines.
    """
    if key not in KEYS:
        raise PicktreeError(f"a plan has no key {key!r}")
    root = read(text, "plan").root
    lines = text.splitlines(keepends=True)
    written = [] if value is None else [f"{key}: {_yaml(value)}\n"]
    if key in root.keys:
        first, last = _lines_of(root, key, lines)
        return "".join([*lines[:first], *written, *lines[last:]])
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    before = [each for each in ("picktree", "kind", *KEYS[: KEYS.index(key)]) if each in root.keys]
    place = max((_lines_of(root, each, lines)[1] for each in before), default=len(lines))
    return "".join([*lines[:place], *written, *lines[place:]])


def _lines_of(root: YamlNode, key: str, lines: list[str]) -> tuple[int, int]:
    """Return the lines of a key with its value; comments and empty lines behind it are not among them."""
    marks = sorted(mark.line for mark in root.keys.values())
    first = root.keys[key].line - 1
    if marks.count(first + 1) > 1 or root.keys[key].column != 1:
        raise PicktreeError("write each key on its own line, then the form can change it")
    last = next((line - 1 for line in marks if line > first + 1), len(lines))
    while last > first + 1 and (not lines[last - 1].strip() or lines[last - 1].startswith("#")):
        last -= 1
    return first, last


def _yaml(value: JsonValue) -> str:
    """Return a value in the flow style, on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_yaml(key)}: {_yaml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value.strip()
    return orjson.dumps(value).decode()


COMMAND_TIMEOUT: Final = 120.0
"""Time limit of a query by a command, wall s."""
_PERIOD: Final = 0.4
_MAX_COMMANDS: Final = 2
"""Maximum number of concurrent query commands."""
Workers = Annotated[int, Field(ge=1, le=256)]


class BatchSlice(Slice):
    """Calls on plans and batches of the folder."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._jobs = studio.jobs
        self._slots = asyncio.Semaphore(_MAX_COMMANDS)

    # Plans.

    @call("plans.form")
    async def form(self, text: str) -> JsonValue:
        """Return the keys of a plan's text with their values."""
        return dict(form_of(text))

    @call("plans.change")
    async def change(self, text: str, key: str, value: JsonValue) -> str:
        """Return the text of a plan with one key changed; all other lines are unchanged."""
        return with_key(text, key, value)

    @call("plans.check")
    async def check(self, path: str, text: str, workers: Workers | None = None) -> JsonValue:
        """Return the faults of a plan's text; without faults its matrix and expected cost."""
        place = self._workspace.resolve(path)
        words = ["batch", "plan", str(place), "--stdin", "--json", "--runs", str(self._runs())]
        words += [] if workers is None else ["--workers", str(workers)]
        found = orjson.loads(await self._answer(words, text, codes=(0, 2)))
        if "faults" in found:
            return {"faults": [{**each, **each["mark"], "advice": each["hint"]} for each in found["faults"]]}
        return {"faults": [], "forecast": found}

    @call("plans.start")
    async def start(self, path: str, workers: Workers | None = None) -> JsonValue:
        """Run a saved plan as a batch of its own folder; return the job's number and the batch's identity.

        The answer comes when the batch has its folder. Raises PicktreeError with what the command said when
        it did not come so far.
        """
        place = self._workspace.resolve(path)
        if not place.is_file():
            raise PicktreeError(f"{path} is not saved yet")
        folder = self._new_folder(place.stem)
        command = ["batch", "run", str(place), "--out", str(folder), *_workers(workers)]
        job = self._begin(f"Batch {folder.name}", command, folder)
        while not (folder / PLAN_FILE).is_file():
            if job.ended is not None:
                raise PicktreeError(job_text(job).strip() or "the batch could not be started")
            await asyncio.sleep(0.1)
        return {"job": job.number, "id": self._workspace.relative(folder)}

    def _new_folder(self, stem: str) -> Path:
        name = re.sub(r"[^\w.-]+", "-", stem).strip(".-")[:80] or "batch"
        stamp = time.strftime("%Y%m%d-%H%M%S")
        for number in range(100):
            folder = self._runs() / f"batch-{name}-{stamp}{f'-{number}' if number else ''}"
            if not folder.exists():
                return folder
        raise PicktreeError("too many batches are started in one second")

    def _runs(self) -> Path:
        return self._workspace.resolve("runs")

    def _begin(self, title: str, command: list[str], folder: Path) -> Job:
        address = f"#/batch/{self._workspace.relative(folder)}"
        return self._jobs.start(title, command, result=address, keeps_on=True)

    # Batches.

    @watch("batches.index")
    async def index(self) -> AsyncIterator[JsonValue]:
        """Yield the batches of the folder with their progress, the last written first, when one changes."""
        last: list[object] | None = None
        while True:
            batches = await asyncio.to_thread(lambda: list(newest_first(batch_folders(self._workspace))))
            stamps: list[object] = [(str(each.place), each.stamp()) for each in batches]
            if stamps != last:
                last = stamps
                yield await asyncio.to_thread(self._rows_of, batches)
            await asyncio.sleep(3 * _PERIOD)

    def _rows_of(self, batches: Iterable[BatchFolder]) -> list[JsonValue]:
        return [self._row(each) for each in batches]

    def _row(self, batch: BatchFolder) -> JsonValue:
        row: dict[str, JsonValue] = {"id": self._workspace.relative(batch.place)}
        try:
            row.update(batch.progress())
        except PicktreeError as error:
            row.update(name=batch.place.name, problem=str(error))
        row.pop("jobs", None)
        return row

    def _batch(self, id: str) -> BatchFolder:
        return BatchFolder(self._workspace.resolve(id))

    @watch("batches.progress")
    async def progress(self, id: str) -> AsyncIterator[JsonValue]:
        """Yield the progress of a batch whenever a job ends, or its process begins or ends."""
        batch, last = self._batch(id), None
        while True:
            stamp = await asyncio.to_thread(batch.stamp)
            if stamp != last:
                last = stamp
                yield {"id": id, **await asyncio.to_thread(batch.progress)}
            await asyncio.sleep(_PERIOD)

    @call("batches.summary")
    async def summary(self, id: str) -> JsonValue:
        """Return the results of a batch, as `picktree batch summary --json` prints them."""
        batch = self._batch(id)
        found = orjson.loads(await self._answer(["batch", "summary", str(batch.place), "--json"]))
        return {**found, "cell": CELL_SIDE}

    @call("batches.behind")
    async def behind(self, id: str, what: Behind, value: str = "", label: str = "") -> JsonValue:
        """Return the jobs that a bar or a cell counts, each with its run where the log was kept."""
        batch = self._batch(id)
        rows = await asyncio.to_thread(batch.jobs_behind, what, value, label)
        return [{**row, "run": self._run_id(batch, row["folder"])} for row in rows]

    def _run_id(self, batch: BatchFolder, folder: JsonValue) -> str:
        """Return the identity of a job's run; empty when its log was not kept."""
        with suppress(PicktreeError):
            path = f"{self._workspace.relative(batch.place)}/{folder}"
            if folder and (self._workspace.resolve(path) / "log.mcap").is_file():
                return path
        return ""

    @call("batches.stop")
    async def stop(self, id: str, now: bool = False) -> None:
        """Let the running jobs of a batch finish and begin no other; `now`: break them off."""
        await asyncio.to_thread(self._batch(id).stop, now=now)

    @call("batches.resume")
    async def resume(self, id: str, workers: Workers | None = None) -> int:
        """Resume a batch; return the job's number."""
        batch = self._batch(id)
        if await asyncio.to_thread(batch.runner) is not None:
            raise PicktreeError("another process runs this batch")
        command = ["batch", "run", "--resume", str(batch.place), *_workers(workers)]
        return self._begin(f"Batch {batch.place.name}", command, batch.place).number

    @call("batches.rerun")
    async def rerun(self, id: str, job: str) -> int:
        """Run a job again whose log was not kept, and compare; return the number of the studio's job."""
        batch = self._batch(id)
        if not re.fullmatch(r"[0-9a-f]{16}", job):
            raise PicktreeError(f"{job!r} is not the id of a job")
        return self._jobs.start(f"Run again: {job}", ["resim", f"{batch.place}@{job}"]).number

    @call("batches.compare")
    async def compare(self, id: str, other: str, label: str = "", other_label: str = "") -> int:
        """Compare two recipes, paired by seed where they share them; return the job's number."""
        sides = [
            f"{self._batch(each).place}{f'@{recipe}' if recipe else ''}"
            for each, recipe in ((id, label), (other, other_label))
        ]
        names = " and ".join(PurePath(each).name for each in (id, other))
        return self._jobs.start(f"Compare {names}", ["batch", "compare", *sides]).number

    @call("batches.write_report")
    async def write_report(self, id: str) -> int:
        """Write the page of a batch into the folder `reports`; return the job's number."""
        batch = self._batch(id)
        path = self._workspace.resolve(f"reports/{batch.place.name}.html")
        path.parent.mkdir(exist_ok=True)
        command = ["batch", "report", str(batch.place), "-o", str(path)]
        address = f"/files/{self._workspace.relative(path)}"
        return self._jobs.start("Write the page", command, result=address).number

    async def _answer(self, words: list[str], text: str = "", codes: tuple[int, ...] = (0,)) -> bytes:
        """Return the output of a command. Raises PicktreeError with its message when it failed."""
        async with self._slots:
            out = await command_answer(
                words, COMMAND_TIMEOUT, text=text, folder=self._workspace.root, codes=codes
            )
        if not out.strip():
            raise PicktreeError(f"picktree {' '.join(words[:2])} said nothing")
        return out


def _workers(number: int | None) -> list[str]:
    return [] if number is None else ["--workers", str(number)]

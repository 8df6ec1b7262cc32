"""Batch slice: plans with their matrix and cost, batches that are started, watched, stopped, compared."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Annotated, Final

import orjson
from pydantic import Field
from starlette.routing import BaseRoute

from ...files.errors import PicktreeError
from .batch_folder import CELL_SIDE, PLAN_FILE, BatchFolder, Behind, batch_folders, newest_first
from .calls import JsonValue, call, watch
from .command_answer import command_answer
from .job_records import Job
from .jobs import job_text
from .plan_text import form_of, with_key
from .slice import Studio

PATIENCE: Final = 120.0
"""Longest time that a question to a command may take, wall s."""
_PERIOD: Final = 0.4
_AT_ONCE: Final = 2
"""Number of commands that answer questions at once."""
Workers = Annotated[int, Field(ge=1, le=256)]


class BatchSlice:
    """Calls on plans and batches of the folder."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._jobs = studio.jobs
        self._slots = asyncio.Semaphore(_AT_ONCE)

    def routes(self) -> Sequence[BaseRoute]:
        return ()

    async def close(self) -> None:
        pass

    # Plans.

    @call("plans.form")
    async def form(self, text: str) -> JsonValue:
        """Return the keys of a plan's text with their values."""
        return dict(form_of(text))

    @call("plans.change")
    async def change(self, text: str, key: str, value: JsonValue) -> str:
        """Return the text of a plan with one key changed; all other lines stay as they are."""
        return with_key(text, key, value)

    @call("plans.check")
    async def check(self, path: str, text: str, workers: Workers | None = None) -> JsonValue:
        """Return the faults of a plan's text; when there is none its matrix, and what it will cost."""
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
        told: list[object] | None = None
        while True:
            batches = await asyncio.to_thread(self._batches)
            stamps: list[object] = [(str(each.place), each.stamp()) for each in batches]
            if stamps != told:
                told = stamps
                yield await asyncio.to_thread(self._rows, batches)
            await asyncio.sleep(3 * _PERIOD)

    def _batches(self) -> list[BatchFolder]:
        return list(newest_first(batch_folders(self._workspace)))

    def _rows(self, batches: list[BatchFolder]) -> list[JsonValue]:
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
        batch, told = self._batch(id), None
        while True:
            stamp = await asyncio.to_thread(batch.stamp)
            if stamp != told:
                told = stamp
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
        """Go on with a batch; return the job's number."""
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
            raise PicktreeError(f"{job!r} is no id of a job")
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
        """Return what a command prints. Raises PicktreeError with what it said when it failed."""
        async with self._slots:
            out = await command_answer(words, PATIENCE, text=text, folder=self._workspace.root, codes=codes)
        if not out.strip():
            raise PicktreeError(f"picktree {' '.join(words[:2])} said nothing")
        return out


def _workers(number: int | None) -> list[str]:
    return [] if number is None else ["--workers", str(number)]

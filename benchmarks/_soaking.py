"""Diary of a soak, written while it runs, and what it amounts to."""

from __future__ import annotations

import ctypes
import json
import math
import resource
import subprocess
import sys
import time
from array import array
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from picktree.session import Interrupter

import numpy as np

if TYPE_CHECKING:
    from picktree.logs import RunResult
    from picktree.session import Execution
    from picktree.world import Tick

MINUTE, QUARTER, HOUR = 60.0, 900.0, 3600.0
"""Simulated s."""
SETTLED = 1800.0
"""Simulated s after which memory must stay where it is."""
PAGE = resource.getpagesize() / 1e6
"""MB"""


@dataclass(frozen=True, slots=True)
class Minute:
    """State of things at the end of a simulated minute."""

    time: float
    """Simulated s."""
    wall: float
    """s since the soak began in this process."""
    cpu: float
    """s of this process."""
    memory: float
    """Resident, MB."""
    heap: float
    """Part of it that is in use of C's heap, MB: the rest is code, and room that was given back."""
    items: int
    """Done so far."""
    came: int
    """Items that have come so far."""
    part: int
    """1 unless the soak was taken up: which process that is."""


@dataclass(frozen=True, slots=True)
class Quarter:
    """Ticks of a quarter of a simulated hour: CPU seconds from one to the next, all that happens between
    two looks at the tree included."""

    time: float
    """Simulated s at its end."""
    ticks: int
    median: float
    """ms"""
    p95: float
    """ms"""
    p999: float
    """ms"""
    mean: float
    """ms"""
    part: int


class Diary(Interrupter):
    """Watches a run and writes a line for each minute and each quarter of an hour into a file, at once: a
    soak that is cut off has told what it knew. It ends the run `seconds` of wall time after its making."""

    def __init__(
        self,
        path: Path,
        part: int = 1,
        *,
        say: bool = True,
        seconds: float | None = None,
    ) -> None:
        self._path, self._part, self._say = path, part, say
        self._until = math.inf if seconds is None else time.monotonic() + seconds
        self._began, self._last = time.perf_counter(), 0.0
        self._minute = self._quarter = 0.0
        self._ticks = array("d")
        self.folder: Path | None = None

    def started(self, run: Execution, folder: Path) -> None:
        self.folder = folder
        self._write({"folder": folder.name, "part": self._part})
        self._last = time.process_time()

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        cpu = time.process_time()
        if self._minute == 0.0:  # the first tick: it may be that of a soak that goes on
            self._minute = MINUTE * (now // MINUTE + 1)
            self._quarter = QUARTER * (now // QUARTER + 1)
        self._ticks.append(cpu - self._last)
        if now >= self._minute - 1e-6:
            self._minute += MINUTE
            wall = time.perf_counter() - self._began
            minute = Minute(
                now,
                round(wall, 1),
                round(cpu, 1),
                round(resident(), 2),
                round(in_use(), 2),
                items_done,
                items_total,
                self._part,
            )
            self._write({"minute": asdict(minute)})
            if self._say:
                print(
                    f"{now / 60:6.0f} min  {items_done:5d} items  {minute.memory:7.1f} MB  "
                    f"{now / max(wall, 1e-9):5.1f} × real time",
                    flush=True,
                )
        if now >= self._quarter - 1e-6:
            self._quarter += QUARTER
            self._write({"quarter": asdict(quarter(now, self._ticks, self._part))})
            self._ticks = array("d")
        self._last = time.process_time()  # what this diary costs is no part of a tick

    def stops(self) -> bool:
        return time.monotonic() > self._until

    def finished(self, result: RunResult) -> None:
        if result.status == "interrupted":
            return  # the next part goes on
        self._write({"result": result.to_json_text(), "part": self._part})

    def opened(self, wanted: int) -> None:
        """Open so many files of the log, each by itself."""
        if self.folder is not None:
            self._write({"opened": asdict(Opened.of(self.folder, wanted)), "part": self._part})

    def died(self, error: BaseException) -> None:
        self._write({"crash": f"{type(error).__name__}: {error}", "part": self._part})

    def _write(self, row: dict[str, object]) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def quarter(now: float, ticks: Iterable[float], part: int) -> Quarter:
    """Return the figures of a quarter of an hour from the CPU seconds of its ticks."""
    ms = 1000 * np.array(ticks)
    return Quarter(
        now,
        len(ms),
        round(float(np.median(ms)), 4),
        round(float(np.percentile(ms, 95)), 4),
        round(float(np.percentile(ms, 99.9)), 4),
        round(float(ms.mean()), 4),
        part,
    )


def resident() -> float:
    """Return the memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


class _Mallinfo(ctypes.Structure):
    """Answer of glibc's mallinfo2."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def in_use() -> float:
    """Return what is in use of C's heap, MB; 0 where no glibc tells it."""
    try:
        asked = ctypes.CDLL(None).mallinfo2
    except AttributeError:
        return 0.0
    asked.restype = _Mallinfo
    told = asked()
    return (int(told.uordblks) + int(told.hblkhd)) / 1e6


@dataclass(frozen=True, slots=True)
class Opened:
    """Log of one process: what was found when its files were opened each by itself."""

    files: int
    size: float
    """MB"""
    drawn: int
    """Number of files that were opened, drawn at random."""
    whole: int
    """Of them those that both the stock reader and `picktree explain` read."""
    faults: tuple[str, ...]

    @classmethod
    def of(cls, folder: Path, wanted: int) -> Opened:
        """Open so many files of a run's folder; all of them for 0."""
        from mcap.reader import make_reader

        files = sorted(folder.glob("*.mcap"))
        size = sum(file.stat().st_size for file in files) / 1e6
        numbers: list[int] = np.random.default_rng(len(files)).permutation(len(files)).tolist()
        drawn = [files[n] for n in sorted(numbers[: wanted or None])]
        faults: list[str] = []
        for file in drawn:
            try:
                with file.open("rb") as stream:
                    messages = sum(1 for _ in make_reader(stream).iter_messages())
            except Exception as error:  # noqa: BLE001  whatever the stock reader says is the answer
                faults.append(f"{file.name}: the stock reader: {error}")
                continue
            command = [sys.executable, "-m", "picktree", "explain", str(file)]
            said = subprocess.run(command, capture_output=True, text=True)
            if said.returncode not in (0, 1) or not messages:
                faults.append(f"{file.name}: picktree explain: {said.stderr.strip().splitlines()[-1:]}")
        return cls(len(files), round(size, 1), len(drawn), len(drawn) - len(faults), tuple(faults))


@dataclass(frozen=True, slots=True)
class Soak:
    """Content of a diary."""

    minutes: tuple[Minute, ...]
    quarters: tuple[Quarter, ...]
    folders: tuple[Path, ...]
    """Folders of the runs, one for each process that went on with it."""
    opened: tuple[Opened, ...]
    result: RunResult | None
    """Result of the last process; None when it was cut off."""
    crash: str

    @classmethod
    def read(cls, path: Path) -> Soak:
        from picktree.logs import RunResult

        rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        results = [row["result"] for row in rows if "result" in row]
        crashes = [row["crash"] for row in rows if "crash" in row]
        return cls(
            tuple(Minute(**row["minute"]) for row in rows if "minute" in row),
            tuple(Quarter(**row["quarter"]) for row in rows if "quarter" in row),
            tuple(path.parent / row["folder"] for row in rows if "folder" in row),
            tuple(Opened(**row["opened"]) for row in rows if "opened" in row),
            RunResult.from_json_text(results[-1], path) if results else None,
            crashes[-1] if crashes else "",
        )


@dataclass(frozen=True, slots=True)
class Growth:
    """Growth of the memory after the first half hour of a process."""

    first: float
    """MB at half an hour."""
    last: float
    """MB at the end."""
    most: float
    """MB at the worst minute after it."""
    an_hour: float
    """MB, by least squares over all minutes after it."""
    an_item: float
    """kB, likewise."""
    heap_an_item: float
    """kB of C's heap in use, likewise."""

    @property
    def share(self) -> float:
        """Share by which the last minute is above the half hour."""
        return self.last / self.first - 1.0


def growth(minutes: Iterable[Minute], settled: float = SETTLED) -> Growth | None:
    """Return the growth of the process that went on longest; None when it was over too early to compare.

    A process that took a soak up begins its half hour when it begins.
    """
    own = _longest(minutes)
    later = [minute for minute in own if minute.time - own[0].time >= settled - 1.5 * MINUTE]
    if len(later) < 3:
        return None
    memory = np.array([minute.memory for minute in later])
    hours = np.array([minute.time for minute in later]) / 3600
    items = np.array([float(minute.items) for minute in later])
    return Growth(
        later[0].memory,
        later[-1].memory,
        float(memory.max()),
        _slope(hours, memory),
        1000 * _slope(items, memory),
        1000 * _slope(items, np.array([minute.heap for minute in later])),
    )


@dataclass(frozen=True, slots=True)
class Steadiness:
    """First hour, without its first half, beside the last: of memory in the process that went on longest, of
    ticks in the whole soak."""

    memory: tuple[float, float]
    """Medians over the minutes, MB."""
    p999: tuple[float, float]
    """Means over the quarters of an hour of a tick's 99.9th percentile, CPU ms."""
    minutes: tuple[int, int]
    """Minutes after the first hour within 3 % of its memory, and all of them."""
    quarters: tuple[int, int]
    """Quarters of an hour after the first hour whose 99.9th percentile is at most 10 % above its, and all."""


def steadiness(soak: Soak) -> Steadiness | None:
    """Return None when no process went on for two hours."""
    own = _longest(soak.minutes)
    if not own or own[-1].time - own[0].time < 2 * HOUR - 1.5 * MINUTE:
        return None
    begin, end = own[0].time - MINUTE, own[-1].time
    first = [minute for minute in own if SETTLED < minute.time - begin <= HOUR + 1]
    later = [minute for minute in own if minute.time - begin > HOUR + 1]
    last = [minute for minute in own if minute.time > end - HOUR]
    memory = float(np.median([minute.memory for minute in first]))
    early = float(np.mean([each.p999 for each in soak.quarters if SETTLED < each.time <= HOUR + 1]))
    late = float(np.mean([each.p999 for each in soak.quarters if each.time > soak.minutes[-1].time - HOUR]))
    after = [each for each in soak.quarters if each.time > HOUR + 1]
    return Steadiness(
        (memory, float(np.median([minute.memory for minute in last]))),
        (early, late),
        (sum(minute.memory <= 1.03 * memory for minute in later), len(later)),
        (sum(each.p999 <= 1.1 * early for each in after), len(after)),
    )


def _longest(minutes: Iterable[Minute]) -> list[Minute]:
    """Return the minutes of the process that went on longest."""
    parts: dict[int, list[Minute]] = {}
    for minute in minutes:
        parts.setdefault(minute.part, []).append(minute)
    return max(parts.values(), key=lambda part: part[-1].time - part[0].time, default=list[Minute]())


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    spread = float(((x - x.mean()) ** 2).sum())
    return float(((x - x.mean()) * (y - y.mean())).sum()) / spread if spread else 0.0

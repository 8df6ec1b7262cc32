"""Records of jobs on the disk, by which a server finds the jobs of one that was killed."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, cast

Outcome: TypeAlias = Literal["running", "done", "no", "failed", "stopped"]
"""`no`: exit code 1, which is the answer no; `failed`: bad input or a fault."""

_OUTCOMES: Final = frozenset({"running", "done", "no", "failed", "stopped"})


@dataclass(frozen=True, slots=True)
class ProcessMark:
    """A process of this machine, told from a later one with the same number."""

    number: int
    began: str
    """Time of its start since the boot, in ticks of the kernel, and the boot."""

    @property
    def alive(self) -> bool:
        """Whether it runs; not when it has ended and nobody has asked for its exit code."""
        return self == mark_of(self.number)


def mark_of(number: int) -> ProcessMark | None:
    """Return the mark of a process that runs; None when there is none of the number."""
    try:
        # After the name, which may hold blanks and brackets: the state, and as the 20th word the start.
        words = Path(f"/proc/{number}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
    return None if words[0] in "ZX" else ProcessMark(number, f"{words[19]} {boot}")


@dataclass(slots=True)
class Job:
    """One command that runs or has run, as its record has it."""

    number: int
    title: str
    command: tuple[str, ...]
    """Words after `picktree`."""
    output: Path
    """File with what it wrote on stdout and stderr."""
    began: float = field(default_factory=time.time)
    """Unix time, s."""
    process: ProcessMark | None = None
    """Process of the command, which leads a session of its own; None: it ended as it began."""
    server: ProcessMark | None = None
    """Server that watches it."""
    result: str = ""
    """Address in the page of what it makes, as `#/run/…` or `/files/…`; empty: none is known."""
    finish: str = ""
    """Name of the function that completes the result at the end; empty: none."""
    keeps_on: bool = False
    """Whether it goes on when the server ends by itself."""
    ended: float | None = None
    """Unix time, s."""
    outcome: Outcome = "running"


class JobRecords:
    """Folder of records: `N.json`, with the output `N.txt` and the exit code `N.code` beside it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def new_number(self, known: int) -> int:
        """Return a number above `known` that no other server has, and keep it."""
        self._folder.mkdir(exist_ok=True, mode=0o700)
        number = max([known, *self._numbers()]) + 1
        while True:
            with suppress(FileExistsError):
                os.close(os.open(self.output(number), os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
                return number
            number += 1

    def output(self, number: int) -> Path:
        return self._folder / f"{number}.txt"

    def code_file(self, number: int) -> Path:
        return self._folder / f"{number}.code"

    def exit_code(self, number: int) -> int | None:
        """Return the exit code of a job; None when its process was killed before it had one."""
        with suppress(OSError, ValueError):
            return int(self.code_file(number).read_text(encoding="utf-8"))
        return None

    def write(self, job: Job) -> None:
        """Keep the record of a job. A disk that refuses costs only that another server finds the job."""
        file = self._folder / f"{job.number}.json"
        with suppress(OSError):
            beside = file.with_suffix(".new")
            beside.write_text(json.dumps(asdict(job), default=str), encoding="utf-8")
            beside.replace(file)

    def read(self) -> Iterator[Job]:
        """Yield the records, the oldest first. A record that cannot be read is left out."""
        for number in self._numbers():
            with suppress(OSError, ValueError, TypeError, KeyError):
                found: object = json.loads((self._folder / f"{number}.json").read_text(encoding="utf-8"))
                yield _parsed(cast("dict[str, Any]", found))

    def delete(self, number: int) -> None:
        for suffix in ("json", "txt", "code"):
            with suppress(OSError):
                (self._folder / f"{number}.{suffix}").unlink(missing_ok=True)

    def _numbers(self) -> list[int]:
        with suppress(OSError):
            return sorted({int(file.stem) for file in self._folder.iterdir() if file.stem.isdecimal()})
        return []


def _parsed(found: dict[str, Any]) -> Job:
    values = dict(found)
    for name in ("process", "server"):
        values[name] = found[name] and ProcessMark(**found[name])
    values.update(command=tuple(found["command"]), output=Path(found["output"]))
    job = Job(**values)
    if job.outcome not in _OUTCOMES:
        raise ValueError(job.outcome)
    return job

"""Golden runs on other processors and in other environments: has each of them one digest everywhere?

    python benchmarks/machines.py                        # all; goes on where it stopped
    python benchmarks/machines.py --no-emulation         # without the emulated processors
    python benchmarks/machines.py --runs 2               # the first two golden runs
    python benchmarks/machines.py --only pick --only insert
    python benchmarks/machines.py --emulator /opt/qemu/bin/qemu-x86_64
    python benchmarks/machines.py --markdown docs/measurements.md

The golden runs of tests/golden are executed natively; natively with environment variables that would have
their libraries compute otherwise; and under `qemu-x86_64 -cpu …` (package qemu-user of Debian), which takes
some 25 times as long. Nothing comes from the disk cache. Finished cells are kept in runs/machines.json for as
long as sources, libraries and processor stay as they are. Exit code 1: a golden run has more than one digest,
or fails somewhere.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from statistics import median
from tempfile import TemporaryFile
from threading import Timer

from _campaign import ROOT

sys.path.insert(0, str(ROOT))

from picktree.files.arithmetic import PINNED, REMOVED, TUNABLES
from picktree.session import sources
from picktree.session.environment import machine

from tests.golden.runs import GOLDEN, Record, differing, libraries

SCRIPT = ROOT / "tests" / "golden" / "runs.py"
CELLS = ROOT / "runs" / "machines.json"
HEADING = "## One digest on every processor"
"""Heading of the section that `--markdown` writes."""
IMPORTS, RUN = 3.0, 0.8
"""CPU time of a process's imports and of one run, s, for the forecast."""
SLOWDOWN = 25
"""Factor on that time under emulation."""
LONGEST = 3600.0
"""Wall time of a run after which its process counts as hung, s."""
SORTS = "import numpy as np; x = np.arange(4093) * 7 % 4093; print((x[x.argsort()] == np.arange(4093)).all())"
WITHOUT_GATHERS = """\
import os, runpy, sys
import picktree
os.environ["NPY_DISABLE_CPU_FEATURES"] += " X86_V3"
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""The script in the first argument, with those kernels of numpy that every x86-64 processor has."""


@dataclass(frozen=True)
class Surroundings:
    """Where golden runs are executed: an environment of this machine, or an emulated processor."""

    name: str
    variables: Mapping[str, str] = field(default_factory=dict[str, str])
    """Environment variables."""
    before: tuple[str, ...] = ()
    """Words of the command before those of Python."""
    alone: bool = False
    """Each run has a process of its own, whose imports count as its CPU time."""
    emulator: str = ""
    """Version of the emulator; empty where there is none."""
    gathers: bool = True
    """Whether the emulator computes gather instructions rightly."""

    @property
    def key(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)


def _with(**variables: str) -> Surroundings:
    return Surroundings(" ".join(f"{name}={value}" for name, value in variables.items()), variables)


NATIVE = (
    Surroundings("a process for each run", alone=True),
    Surroundings("one process for all runs"),
    _with(OPENBLAS_CORETYPE="Sandybridge"),
    _with(OPENBLAS_CORETYPE="SkylakeX"),
    _with(NPY_DISABLE_CPU_FEATURES=""),
    _with(NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR"),
    _with(NPY_ENABLE_CPU_FEATURES="X86_V4 AVX512_ICL"),
    _with(GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"),
    _with(OPENBLAS_NUM_THREADS="8", OMP_NUM_THREADS="7", MKL_NUM_THREADS="3"),
    _with(OPENCV_CPU_DISABLE="AVX512-SKX,AVX2,FP16,AVX,SSE4.2,SSE4.1"),
    _with(OPENCV_IPP="sse42"),
    _with(OPENCV_IPP="disabled"),
    _with(JSIMD_FORCENONE="1"),
    _with(PYTHONHASHSEED="1"),
    _with(MALLOC_PERTURB_="85"),
    Surroundings("one core (taskset)", before=("taskset", "-c", str(min(os.sched_getaffinity(0))))),
)
"""Environments of this machine. Without `arithmetic.py` the two of OPENBLAS_CORETYPE, the first and the
third of NPY and the one of GLIBC_TUNABLES change digests on a processor with AVX-512."""
PROCESSORS = ("Haswell", "Skylake-Client", "Cascadelake-Server", "EPYC-Rome", "EPYC-Milan", "Dhyana")
"""Models with AVX2 and FMA: of Intel, of AMD, and of a maker that libraries may not know (Dhyana)."""


@dataclass(frozen=True)
class Cell:
    """Outcome of one golden run in one of the surroundings."""

    digest: str
    """Empty when it failed."""
    cpu_seconds: float
    """CPU time, s."""
    failure: str = ""
    """Last line that it printed on stderr."""


class Cells:
    """Finished cells on the disk, by surroundings and golden run."""

    def __init__(self, file: Path, state: str) -> None:
        self._file, self._state = file, state
        kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        known = kept.get("cells", {}) if kept.get("state") == state else {}
        self._cells = {key: {run: Cell(**cell) for run, cell in row.items()} for key, row in known.items()}

    def row(self, where: Surroundings) -> Mapping[str, Cell]:
        """Return the finished cells of these surroundings by golden run."""
        return self._cells.get(where.key, {})

    def add(self, where: Surroundings, run: str, cell: Cell) -> None:
        self._cells.setdefault(where.key, {})[run] = cell
        self._file.parent.mkdir(parents=True, exist_ok=True)
        plain = {key: {run: asdict(cell) for run, cell in row.items()} for key, row in self._cells.items()}
        beside = self._file.with_suffix(".part")
        beside.write_text(json.dumps({"state": self._state, "cells": plain}, indent=1), encoding="utf-8")
        beside.replace(self._file)


@dataclass(frozen=True)
class Row:
    """Digests of one golden run: the recorded one, and those of the surroundings."""

    run: str
    recorded: str
    """Digest in digests.json; empty when other libraries computed it."""
    native: Mapping[str, Cell]
    """Cells by the names of their surroundings."""
    emulated: Mapping[str, Cell]

    @property
    def reference(self) -> str:
        """Digest with which the others are compared."""
        return self.recorded or next((cell.digest for cell in self.native.values() if cell.digest), "")

    def others(self, cells: Mapping[str, Cell]) -> list[str]:
        """Return the surroundings that have another digest, or none."""
        return [name for name, cell in cells.items() if cell.digest != self.reference]

    @property
    def one_digest(self) -> bool:
        return bool(self.reference) and not self.others({**self.native, **self.emulated})


def state() -> str:
    """Return a fingerprint of the sources, libraries and processor on which all cells depend."""
    files = (SCRIPT, *sorted(SCRIPT.parent.glob("*.yaml")))
    hashes = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    plain = [dict(sources()), hashes, libraries(), machine()["processor"]]
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def emulated(emulator: str) -> tuple[list[Surroundings], dict[str, str]]:
    """Return the emulated processors, and why some are left out, by name."""
    if shutil.which(emulator) is None:
        return [], dict.fromkeys(PROCESSORS, f"{emulator} is not installed")
    version = _output(emulator, "--version").partition("\n")[0].partition(" (")[0]
    known = set(_output(emulator, "-cpu", "help").split())
    found = {name: name in known or f"x86_{name}" in known for name in PROCESSORS}
    right = _sorts(emulator, next((name for name in PROCESSORS if found[name]), ""))
    where = [
        Surroundings(name, before=(emulator, "-cpu", name), emulator=version, gathers=right)
        for name in PROCESSORS
        if found[name]
    ]
    return where, {name: f"{version} does not know it" for name in PROCESSORS if not found[name]}


@cache
def _sorts(emulator: str, processor: str) -> bool:
    """Return whether numpy sorts there: qemu before 9.1 mistakes a register of gathers (issue 2474)."""
    return _output(emulator, "-cpu", processor, sys.executable, "-c", SORTS).split()[-1:] == ["True"]


def _output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def execute(runs: Sequence[str], where: Surroundings) -> Iterator[tuple[str, Cell]]:
    """Execute golden runs there, and yield the cell of each as soon as it is finished."""
    left = list(runs)
    while left:
        together = left[:1] if where.alone else left
        before, done = _cpu_of_children(), 0
        with TemporaryFile("w+", encoding="utf-8") as errors:
            process = _start(together, where, errors.fileno())
            timer = Timer(LONGEST * len(together), process.kill)
            timer.start()
            assert process.stdout is not None
            for line in process.stdout:
                found = json.loads(line)
                if where.alone:
                    process.wait()
                    found["cpu_seconds"] = round(_cpu_of_children() - before, 2)
                yield found["name"], Cell(found["digest"], found["cpu_seconds"])
                done += 1
            code = process.wait()
            timer.cancel()
            errors.seek(0)
            said = errors.read().strip().splitlines()
        if done < len(together):
            spent = round(_cpu_of_children() - before, 2)
            yield together[done], Cell("", spent, said[-1] if said else f"exit code {code}")
            done += 1
        left = left[done:]


def _start(runs: Sequence[str], where: Surroundings, errors: int) -> subprocess.Popen[str]:
    chosen = {*PINNED, *REMOVED, TUNABLES, *(name for one in NATIVE for name in one.variables)}
    environment = {name: value for name, value in os.environ.items() if name not in chosen}
    script = [str(SCRIPT)] if where.gathers else ["-c", WITHOUT_GATHERS, str(SCRIPT)]
    return subprocess.Popen(
        [*where.before, sys.executable, *script, *runs],
        env=environment | {"PICKTREE_CACHE": ""} | where.variables,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def to_table(rows: Sequence[Row]) -> list[str]:
    """Return a Markdown table with a row for each golden run."""
    lines = [
        "| golden run | one digest | environments | emulated processors | CPU s | with imports | emulated |",
        "|---|---|---|---|---|---|---|",
    ]
    alone = [one.name for one in NATIVE if one.alone]
    for row in rows:
        together = {name: cell for name, cell in row.native.items() if name not in alone}
        single = {name: cell for name, cell in row.native.items() if name in alone}
        cells = [
            row.run,
            "yes" if row.one_digest else "**no**",
            _agreement(row, row.native),
            _agreement(row, row.emulated),
            *map(_cpu, (together, single, row.emulated)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _agreement(row: Row, cells: Mapping[str, Cell]) -> str:
    others = row.others(cells)
    if not cells:
        return "–"
    count = f"{len(cells) - len(others)} of {len(cells)}"
    return f"{count}; not {', '.join(f'`{name}`' for name in others)}" if others else count


def _cpu(cells: Mapping[str, Cell]) -> str:
    return f"{median(cell.cpu_seconds for cell in cells.values()):.1f}" if cells else "–"


def to_section(rows: Sequence[Row], where: Sequence[Surroundings], skipped: Mapping[str, str]) -> str:
    """Return the section for docs/measurements.md."""
    environments = [one.name for one in where if not one.emulator]
    processors = [one for one in where if one.emulator]
    text = [
        "`python benchmarks/machines.py`: the golden runs of `tests/golden` in "
        f"{len(environments)} environments of one machine ({machine()['processor']})"
    ]
    if processors:
        names = ", ".join(one.name for one in processors)
        text.append(f", and under {processors[0].emulator} as {names}")
    text.append(
        f". {sum(row.one_digest for row in rows)} of {len(rows)} have one digest. CPU seconds are medians "
        "of a run in a process that executes all of them, and of a process with one run, imports included."
    )
    if any(not one.gathers for one in processors):
        text.append(
            " This emulator errs in gather instructions, as qemu before 9.1 does, so numpy used its kernels "
            "without them."
        )
    left = [f"Left out: {name}: {why}." for name, why in skipped.items()]
    listed = f"Environments: {', '.join(f'`{name}`' for name in environments)}."
    return "\n".join([HEADING, "", "".join(text), "", *to_table(rows), "", listed, *left, ""])


def put(section: str, page: str) -> str:
    """Return the page with that section instead of the one with its heading, or at its end."""
    heading = section.partition("\n")[0]
    before, found, after = page.partition(f"{heading}\n")
    if not found:
        return f"{page.rstrip()}\n\n{section}"
    _, mark, rest = after.partition("\n## ")
    return f"{before}{section}{mark}{rest}"


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, metavar="N", help="the first N golden runs")
    parser.add_argument(
        "--only", action="append", choices=GOLDEN, metavar="NAME", help="this golden run; repeatable"
    )
    parser.add_argument("--no-emulation", action="store_true")
    parser.add_argument("--emulator", default="qemu-x86_64", metavar="PROGRAM")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help=f"write the section '{HEADING[3:]}' there"
    )
    return parser


def main() -> int:
    given = _options().parse_args()
    runs = [name for name in GOLDEN if given.only is None or name in given.only][: given.runs]
    processors, skipped = ([], {}) if given.no_emulation else emulated(given.emulator)
    where = [one for one in (*NATIVE, *processors) if not one.before or shutil.which(one.before[0])]
    skipped |= {one.name: f"{one.before[0]} is not installed" for one in NATIVE if one not in where}
    cells = Cells(CELLS, state())
    to_do = [(one, [run for run in runs if run not in cells.row(one)]) for one in where]
    print(
        _forecast(to_do, len(runs)), *(f"left out: {name}: {why}" for name, why in skipped.items()), sep="\n"
    )
    for one, missing in to_do:
        for run, cell in execute(missing, one):
            cells.add(one, run, cell)
            text = f"{one.name}: {run}: {cell.digest[:12] or cell.failure}, {cell.cpu_seconds:.1f} CPU s"
            print(text, file=sys.stderr, flush=True)
    record = Record.read()
    recorded = {} if differing(record.libraries, libraries()) else record.digests
    rows = [
        Row(
            run,
            recorded.get(run, ""),
            {one.name: cells.row(one)[run] for one in where if not one.emulator},
            {one.name: cells.row(one)[run] for one in where if one.emulator},
        )
        for run in runs
    ]
    print(*to_table(rows), sep="\n")
    if given.markdown:
        page = given.markdown.read_text(encoding="utf-8")
        given.markdown.write_text(put(to_section(rows, where, skipped), page), encoding="utf-8")
    return 0 if all(row.one_digest for row in rows) else 1


def _forecast(to_do: Sequence[tuple[Surroundings, Sequence[str]]], runs: int) -> str:
    cost = 0.0
    for one, missing in to_do:
        processes = len(missing) if one.alone else bool(missing)
        cost += (processes * IMPORTS + len(missing) * RUN) * (SLOWDOWN if one.emulator else 1)
    count = sum(len(missing) for _, missing in to_do)
    return f"{count} of {len(to_do) * runs} cells to do, about {cost / 60:.0f} CPU minutes; cells in {CELLS}"


if __name__ == "__main__":
    sys.exit(main())

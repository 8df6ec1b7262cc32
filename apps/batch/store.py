"""Store of a batch's results, one SQLite file with one writing process: queries, export, names of jobs."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import shlex
import sqlite3
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TypeAlias

from picktree.analysis.export import table_files
from picktree.files import PicktreeError, suggest_name
from picktree.logs import FigureCounts, PandasTable

from .plan import Job, Variant
from .tables import CHILDREN, TABLES, VERSION, VIEWS, CrashRow, FigureRow, JobRow, JobRows, TableOf, schema

Read: TypeAlias = Callable[[TableOf], Iterator[tuple[table_files.Cell, ...]]]


@dataclass(frozen=True, slots=True)
class QueryResult(PandasTable):
    """Result of a query. Its rows are mappings by column for a loop and for `pandas.DataFrame`."""

    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    def columns_by_name(self) -> Mapping[str, Sequence[object]]:
        return {name: [row[n] for row in self.rows] for n, name in enumerate(self.columns)}

    def to_text(self) -> str:
        """Return the columns side by side, numbers aligned right."""
        cells = [[_cell(value) for value in row] for row in self.rows]
        widths = [
            max([len(column), *(len(row[n]) for row in cells)]) for n, column in enumerate(self.columns)
        ]
        right = [any(isinstance(row[n], int | float) for row in self.rows) for n in range(len(self.columns))]
        lines = [list(self.columns), ["─" * width for width in widths], *cells]
        return "\n".join(
            "  ".join(
                text.rjust(width) if aside else text.ljust(width)
                for text, width, aside in zip(line, widths, right, strict=True)
            ).rstrip()
            for line in lines
        )

    def to_csv(self) -> str:
        """Return CSV by RFC 4180, with a line of column names."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.columns)
        writer.writerows(self.rows)
        return text.getvalue()

    def to_json_text(self) -> str:
        """Return JSON with `columns` and `rows`; values without a JSON form become text."""
        rows = [[_plain(value) for value in row] for row in self.rows]
        return json.dumps({"columns": self.columns, "rows": rows}, ensure_ascii=False) + "\n"


def run_query(path: Path, sql: str) -> QueryResult:
    """Run a SELECT. Raises PicktreeError for invalid SQL, and for statements that would change the
    results."""
    try:
        with closing(_connection(path)) as connection:
            cursor = connection.execute(sql)
            if cursor.description is None:
                raise PicktreeError("the query cannot be answered: it is not a SELECT")
            return QueryResult(tuple(column[0] for column in cursor.description), tuple(cursor.fetchall()))
    except (sqlite3.Error, sqlite3.Warning) as error:
        raise PicktreeError(f"the query cannot be answered: {_error_words(error)}") from None


@contextmanager
def read_tables(path: Path) -> Generator[Read]:
    """Yield a reader of tables at one moment: rows in the order of the jobs, within a job as recorded.

    Raises PicktreeError when they cannot be read.
    """
    with closing(_connection(path)) as connection:
        connection.execute("BEGIN")

        def rows(table: TableOf) -> Iterator[tuple[table_files.Cell, ...]]:
            names = ", ".join(f"t.{column.name}" for column in table.columns)
            found = connection.execute(
                f"SELECT {names} FROM {table.name} AS t JOIN jobs USING (job) ORDER BY jobs.number, t.rowid"
            )
            flags = [column.kind == "bool" for column in table.columns]
            if not any(flags):
                return iter(found)
            return (
                tuple(bool(cell) if flag else cell for cell, flag in zip(row, flags, strict=True))
                for row in found
            )

        try:
            yield rows
        except sqlite3.Error as error:
            raise PicktreeError(f"{path}: the results cannot be read: {error}") from None


def _connection(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)


def _error_words(error: Exception) -> str:
    """Return the error's text, with the nearest valid name for an unknown table or column."""
    message = str(error)
    missing, _, name = message.partition(": ")
    match missing:
        case "no such table":
            known = [*(table.name for table in TABLES), *(view.name for view in VIEWS)]
            return f"{message} ({suggest_name(name, known)})"
        case "no such column":
            columns = sorted({column.name for table in TABLES for column in table.columns})
            hint = suggest_name(name.rpartition(".")[2], columns)
            return f"{message} ({hint})" if hint.startswith("did") else message  # there are too many to list
        case "attempt to write a readonly database":
            return "the query would change the results; a query may only read them"
        case _:
            return message


def _plain(value: object) -> object:
    if isinstance(value, bytes) or (isinstance(value, float) and not math.isfinite(value)):
        return str(value)
    return value


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


RESULTS_FILE = "results.sqlite"


class Store:
    """Results in a batch's folder. A context manager.

    All methods raise PicktreeError when the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        """Open existing results."""
        if not path.is_file():
            raise PicktreeError(f"{path.parent}: not a batch: there is no {path.name} in this folder")
        self.path = path
        self._connection = _connect(path)
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if version != VERSION:
            self.close()
            raise PicktreeError(
                f"{path}: results of version {version}; this picktree reads {VERSION}: "
                "use the one that wrote them"
            )

    @classmethod
    def create(cls, path: Path, jobs: Iterable[Job]) -> Store:
        """Create results for these jobs, none of them run. Raises PicktreeError when results exist
        already."""
        if path.exists():
            raise PicktreeError(f"{path.parent}: there is a batch already; continue it with --resume")
        beside = path.with_suffix(".part")
        for left in path.parent.glob(f"{beside.name}*"):  # of a creation that was cut short
            left.unlink()
        with closing(_connect(beside)) as connection, connection:
            connection.executescript(schema())
            connection.executemany(
                "INSERT INTO jobs (job, number, variant, mission, scene, robot, faults, settings, seed, "
                "recipe) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                map(_planned, jobs),
            )
            connection.execute(f"PRAGMA user_version = {VERSION}")
        beside.rename(path)
        return cls(path)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._connection.close()

    def jobs(self) -> tuple[Job, ...]:
        """Return the jobs in the order of the plan."""
        found = self._connection.execute(
            "SELECT job, number, mission, scene, robot, faults, settings, variant, seed, recipe FROM jobs "
            "ORDER BY number"
        )
        return tuple(
            Job(job, number, variant, seed, recipe)
            for job, number, mission, scene, robot, faults, settings, label, seed, recipe in found
            for variant in (
                Variant(
                    Path(mission),
                    scene or None,
                    Path(faults) if faults else None,
                    json.loads(settings),
                    label,
                    robot or None,
                ),
            )
        )

    def to_do(self) -> frozenset[str]:
        """Return the ids of the jobs that have not run or have crashed."""
        found = self._connection.execute("SELECT job FROM jobs WHERE status IN ('waiting', 'crashed')")
        return frozenset(row[0] for row in found)

    def recorded(self) -> tuple[JobRow, ...]:
        """Return the rows of the finished jobs, in the order of the plan."""
        return self._rows("status NOT IN ('waiting', 'crashed') ORDER BY number")

    def row(self, job: str) -> JobRow | None:
        """Return the row of a job; None when it was not run yet."""
        return next(iter(self._rows("job = ? AND status <> 'waiting'", job)), None)

    def _rows(self, condition: str, *values: str) -> tuple[JobRow, ...]:
        names = ", ".join(field.name for field in fields(JobRow))
        found = self._connection.execute(f"SELECT {names} FROM jobs WHERE {condition}", values)
        return tuple(JobRow(*row) for row in found)

    def figures(self) -> Mapping[str, FigureCounts]:
        """Return the counts of the operators' figures by job, in the order of the plan; none of crashed
        jobs."""
        names = ", ".join(f"figures.{each.name}" for each in fields(FigureRow))
        times: dict[str, list[float]] = {}
        for job, seconds in self._connection.execute(
            "SELECT job, seconds FROM times_to_done ORDER BY job, unit"
        ):
            times.setdefault(job, []).append(seconds)
        found = self._connection.execute(
            f"SELECT job, sim_seconds, {names} FROM jobs JOIN figures USING (job) ORDER BY number"
        )
        return {
            job: FigureRow(*row).counts(seconds or 0.0, tuple(times.get(job, ())))
            for job, seconds, *row in found
        }

    def versions(self, job: str) -> dict[str, str]:
        """Return the versions of the libraries that a job was run with."""
        return dict(self._connection.execute("SELECT library, version FROM versions WHERE job = ?", (job,)))

    def set_folder(self, job: str, folder: str) -> None:
        """Set the folder of a job's run, relative to the batch's folder."""
        with self._writing():
            self._connection.execute("UPDATE jobs SET folder = ? WHERE job = ?", (folder, job))

    def lost_tries(self) -> dict[str, int]:
        """Return the number of lost attempts of each job that has no result yet."""
        return dict(
            self._connection.execute(
                "SELECT job, count(*) FROM crashes JOIN jobs USING (job) WHERE status = 'waiting' "
                "GROUP BY job"
            )
        )

    def lose(self, job: str, crash: CrashRow) -> None:
        """Record an attempt without a result."""
        with self._writing():
            self._insert("crashes", CrashRow, job, [crash])

    def reset_crashed(self, job: str) -> None:
        """Reset a job that crashed to waiting."""
        with self._writing():
            crashed = self._connection.execute(
                "UPDATE jobs SET status = 'waiting', message = '', attempts = 0, last_tick = NULL, "
                "look_at = '', folder = '' WHERE job = ? AND status = 'crashed'",
                (job,),
            )
            if crashed.rowcount:
                self._connection.execute("DELETE FROM crashes WHERE job = ?", (job,))

    def record(self, job: str, rows: JobRows, crash: CrashRow | None = None) -> bool:
        """Record all results of a job, or none; return False when they were recorded before.

        `crash`: the last attempt, where it had no result.
        """
        names = [field.name for field in fields(JobRow)]
        changes = ", ".join(f"{name} = ?" for name in names)
        with self._writing():
            changed = self._connection.execute(
                f"UPDATE jobs SET {changes} WHERE job = ? AND status IN ('waiting', 'crashed')",
                (*astuple(rows.job), job),
            )
            if changed.rowcount != 1:
                return False
            for table in (*CHILDREN, "versions"):
                self._connection.execute(f"DELETE FROM {table} WHERE job = ?", (job,))
            for table, kind in CHILDREN.items():
                self._insert(table, kind, job, getattr(rows, table))
            self._connection.executemany(
                "INSERT INTO versions VALUES (?, ?, ?)",
                [(job, library, version) for library, version in rows.versions.items()],
            )
            if crash is not None:
                self._insert("crashes", CrashRow, job, [crash])
        return True

    @contextmanager
    def _writing(self) -> Generator[None]:
        """Run the block as one transaction."""
        try:
            with self._connection:
                yield
        except sqlite3.Error as error:
            raise PicktreeError(
                f"{self.path}: the results cannot be written: {error}; nothing that was recorded is lost: "
                f"mend the cause, and continue with --resume {self.path.parent}"
            ) from None

    def query(self, sql: str) -> QueryResult:
        """Run a SELECT; it cannot change the results. Raises PicktreeError for invalid SQL."""
        return run_query(self.path, sql)

    def _insert(self, table: str, kind: type, job: str, rows: Sequence[object]) -> None:
        names = [field.name for field in fields(kind)]
        places = ", ".join("?" * (len(names) + 1))
        self._connection.executemany(
            f"INSERT INTO {table} (job, {', '.join(names)}) VALUES ({places})",
            [(job, *(getattr(row, name) for name in names)) for row in rows],
        )


def _planned(job: Job) -> tuple[str | int, ...]:
    """Return the cells of a job that was not run, in the order of the columns."""
    variant = job.variant
    return (
        job.id, job.number, variant.label, str(variant.mission), variant.scene or "",
        variant.robot or "", str(variant.faults or ""), json.dumps(dict(variant.settings)), job.seed,
        job.recipe,
    )  # fmt: skip


def _connect(path: Path) -> sqlite3.Connection:
    try:
        connection = sqlite3.connect(path)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA foreign_keys = ON")
    except sqlite3.Error as error:
        raise PicktreeError(f"{path}: the results cannot be opened: {error}") from None
    return connection


@dataclass(frozen=True, slots=True)
class ExportedTables:
    """Written files with their number of rows."""

    form: table_files.TableForm
    output: Path
    rows: Mapping[Path, int]

    def to_text(self) -> str:
        """Return a text for a terminal, without a trailing newline."""
        return table_files.counts_text(self.rows, 8)

    def to_json_text(self) -> str:
        tables = {path.stem: count for path, count in self.rows.items()}
        values = {"to": self.form, "output": str(self.output.absolute()), "tables": tables}
        return json.dumps(values, ensure_ascii=False, indent=2) + "\n"


def export(store: Store, form: table_files.TableForm, output: Path) -> ExportedTables:
    """Write every table to the folder `output`, either all or none.

    Raises PicktreeError when it cannot be written or a library is missing.
    """
    with read_tables(store.path) as rows:
        return ExportedTables(form, output, table_files.write_tables(form, output, TABLES, rows))


def dropped_logs(folder: Path, program: str = "picktree") -> str:
    """Return a sentence on the jobs of a batch whose logs were not kept; empty when all were, or no batch.

    Raises PicktreeError when the results cannot be read.
    """
    path = folder / RESULTS_FILE
    if not path.is_file():
        return ""
    with Store(path) as store:
        rows = store.query("SELECT count(*), sum(folder = '') FROM jobs WHERE status <> 'waiting'").rows
    ((done, dropped),) = rows
    if not dropped:
        return ""
    where = shlex.quote(str(folder))
    return (
        f"the batch has kept no log of {dropped} of {done} jobs, which are not counted here; "
        f"`{program} batch summary {where}` has the figures of all"
    )


_BY_SEED = re.compile(r"(?:(?P<label>.*),)?\s*seed=(?P<seed>\d+)")
GRAMMAR = "a job's id or its beginning, seed=7, or LABEL,seed=7"


def split(where: str) -> tuple[Path, str]:
    """Return the folder and the name in it; empty without an @. A folder's name may contain an @."""
    if (Path(where) / RESULTS_FILE).exists():
        return Path(where), ""
    parts = where.split("@")
    for count in range(len(parts) - 1, 0, -1):
        if (Path("@".join(parts[:count])) / RESULTS_FILE).exists():
            return Path("@".join(parts[:count])), "@".join(parts[count:])
    folder, _, named = where.partition("@")
    return Path(folder), named


def choose_label(wanted: str, labels: Sequence[str], where: str, folder: Path, after: str = "") -> str:
    """Return the label that matches; a part of it is enough. Raises PicktreeError when none or several do."""
    exact = [label for label in labels if label == wanted]
    fitting = exact or [label for label in labels if wanted in label]
    if len(fitting) != 1:
        hint = suggest_name(wanted, labels) if wanted and not fitting else "one of " + "; ".join(labels)
        raise PicktreeError(f"{where}: name one recipe as {folder}@LABEL{after} ({hint})")
    return fitting[0]


def find_job(store: Store, where: str, named: str) -> Job:
    """Return the job named by an id, its beginning, or a seed. Raises PicktreeError."""
    jobs = store.jobs()
    folder = store.path.parent
    by_seed = _BY_SEED.fullmatch(named)
    if by_seed is None:
        fitting = [job for job in jobs if named and job.id.startswith(named)]
        if len(fitting) > 1:
            raise PicktreeError(
                f"{where}: the ids of {len(fitting)} jobs begin like this: {fitting[0].id}, "
                f"{fitting[1].id}, …"
            )
        if not fitting:
            raise PicktreeError(f"{where}: there is no such job; name it as {GRAMMAR}")
        return fitting[0]
    seed = int(by_seed["seed"])
    having = [job for job in jobs if job.seed == seed]
    if not having:
        seeds = sorted({job.seed for job in jobs})
        raise PicktreeError(
            f"{where}: no job has the seed {seed}; {len(seeds)} seeds from {seeds[0]} to {seeds[-1]}"
        )
    labels = list(dict.fromkeys(job.variant.label for job in having))
    label = choose_label((by_seed["label"] or "").strip(), labels, where, folder, f",seed={seed}")
    return next(job for job in having if job.variant.label == label)


def find_run(where: str) -> str:
    """Return the folder of the run that FOLDER@JOB names; any other name of a log is returned unchanged.

    Raises PicktreeError when there is no such job, or the batch keeps no log of it.
    """
    folder, named = split(where)
    if Path(where).exists() or not named or not (folder / RESULTS_FILE).is_file():
        return where
    with Store(folder / RESULTS_FILE) as store:
        job = find_job(store, where, named)
        row = store.row(job.id)
    if row is None:
        raise PicktreeError(f"{where}: this job was not run yet; picktree batch run --resume {folder}")
    run = folder / row.folder
    if not row.folder or not run.is_dir():
        raise PicktreeError(
            f"{where}: the batch keeps no log of this job ({row.status}); `picktree resim {where}` makes it"
        )
    return str(run)

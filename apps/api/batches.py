"""Batches in Python: one mission with many seeds and settings, and the comparison of its variants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from picktree.apps.batch import (
    RESULTS_FILE,
    Batch,
    BatchSummary,
    LocalExecutor,
    QueryResult,
    RecipeComparison,
    Store,
    compare_recipes,
    plan_of,
    read_recipe,
    summarise,
    text_of,
)
from picktree.files import PicktreeError, file_system
from picktree.simulation import Backend
from picktree.trees import Node
from picktree.world import Plain

from .display import html_table, preformatted
from .mission import Mission
from .runs import setting_text

if TYPE_CHECKING:
    from picktree.apps.batch import Job, JobRow, Keep, RecordedJob


class BatchResult:
    """Results of a batch, in its folder. `variants` are the labels of its combinations without the seed."""

    def __init__(self, folder: str | PathLike[str]) -> None:
        """Open the batch of a folder. Raises PicktreeError for a folder without a batch."""
        self.folder = Path(folder)
        with self._store() as store:
            self.variants = tuple(dict.fromkeys(job.variant.label for job in store.jobs()))

    def summary(self) -> BatchSummary:
        """Return rates with intervals, causes of failures, and the jobs worth a look."""
        with self._store() as store:
            return summarise(store)

    def query(self, sql: str) -> QueryResult:
        """Return the rows of an SQL query over the tables `jobs`, `items`, `failures` and others."""
        with self._store() as store:
            return store.query(sql)

    def compare(self, a: str | None = None, b: str | None = None) -> VariantComparisons:
        """Compare two variants by their labels, paired by seed; by default the first with each other one.

        Raises PicktreeError for an unknown label, or when there is one variant only.
        """
        first = a or self.variants[0]
        others = [b] if b is not None else [label for label in self.variants if label != first]
        if not others:
            raise PicktreeError("the batch has one variant only: give settings, scenes, robots or faults")
        base = read_recipe(f"{self.folder}@{first}")
        return VariantComparisons(
            tuple(compare_recipes(base, read_recipe(f"{self.folder}@{other}")) for other in others)
        )

    def _store(self) -> Store:
        return Store(self.folder / RESULTS_FILE)

    def __repr__(self) -> str:
        return self.summary().to_text()

    def _repr_html_(self) -> str:
        recipes = self.summary().recipes
        rows = [(each.label, each.success, each.items, each.crashed) for each in recipes]
        return html_table(("variant", "goal reached", "items sorted", "crashed"), rows)


class VariantComparisons(Sequence[RecipeComparison]):
    """Comparisons of one variant with others: each with intervals, p values and the seeds that changed."""

    def __init__(self, found: tuple[RecipeComparison, ...]) -> None:
        self._found = found

    def __getitem__(self, index: int) -> RecipeComparison:  # type: ignore[override]
        return self._found[index]

    def __len__(self) -> int:
        return len(self._found)

    @property
    def differ(self) -> bool:
        """Whether any two differ by more than chance explains."""
        return any(each.differ for each in self._found)

    def __repr__(self) -> str:
        return "\n\n".join(map(text_of, self._found))

    def _repr_html_(self) -> str:
        return preformatted(repr(self))


class _Silent:
    """Observer of a batch that shows nothing."""

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None: ...
    def ended(self, ended: RecordedJob) -> None: ...
    def tried_again(self, job: Job, reason: str) -> None: ...
    def stopping(self, under_way: int) -> None: ...
    def waiting(self) -> None: ...


def batch(
    mission: Mission | Node | str | PathLike[str],
    *,
    seeds: Iterable[int],
    settings: Mapping[str, Plain | Sequence[Plain]] | None = None,
    scenes: Sequence[str] = (),
    faults: Sequence[str | PathLike[str]] = (),
    backend: Backend = "physics",
    limit: float = 3600.0,
    workers: int | None = None,
    keep: Keep = "failures",
    out: str | PathLike[str] | None = None,
) -> BatchResult:
    """Run a mission with every seed and each combination of settings, scenes and faults.

    `settings` has the values to try by parameter of the mission, or by port of its nodes: `{"Grasp.force":
    [10, 30]}` sets it in all nodes of that name. `limit` is in simulated s. `workers` is the number of jobs
    at once, by default one a core. `keep` selects the jobs whose logs are kept: `all`, `failures` or `none`.
    `out` is the batch's folder. Raises PicktreeError (FileError with all faults) for bad input. Ctrl-C breaks
    off the batch; its folder keeps what has ended."""
    if isinstance(mission, Node):
        mission = Mission(mission, name=mission.description.id)
    name = mission.name if isinstance(mission, Mission) else Path(mission).stem
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = Path(out) if out is not None else Path("runs") / f"batch-{name.replace('/', '-')}-{stamp}"
    plan = plan_of(
        {
            "name": name,
            "missions": [str(_file(mission, folder).absolute())],
            "seeds": ",".join(map(str, seeds)),
            "scenes": list(scenes),
            "faults": [_faults_file(each) for each in faults],
            "set": {key: _values(value) for key, value in (settings or {}).items()},
            "backend": backend,
            "limit": f"{limit} s",
            "keep": keep,
        }
    )
    with LocalExecutor(workers) as executor, Batch.create(folder, plan) as made:
        try:
            complete = made.run(executor, _Silent())
        except KeyboardInterrupt:
            made.break_off()
            raise
    if not complete:
        raise PicktreeError(
            f"{folder}: the batch was stopped; `picktree batch run --resume {folder}` continues it"
        )
    return BatchResult(folder)


def _file(mission: Mission | str | PathLike[str], folder: Path) -> Path:
    """Return the mission's file; one that was made in Python is written into the batch's folder."""
    if not isinstance(mission, Mission):
        return file_system.example_file(mission)
    if mission.file is not None:
        return mission.file
    folder.mkdir(parents=True, exist_ok=True)
    return mission.save(folder / "mission.yaml")


def _faults_file(faults: str | PathLike[str]) -> str:
    if faults == "none":
        return "none"
    return str(file_system.example_file(faults, "faults", "faults file").absolute())


def _values(value: Plain | Sequence[Plain]) -> list[str]:
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    return [setting_text(each) for each in values]

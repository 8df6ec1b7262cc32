"""Names of a recipe or a job of a batch on the command line: FOLDER@LABEL, FOLDER@JOB."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...errors import PicktreeError
from ...files.value_wording import suggest_name
from ..plan import Job
from .store import RESULTS_FILE, Store

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
            raise PicktreeError(f"{where}: {len(fitting)} jobs begin so: {fitting[0].id}, {fitting[1].id}, …")
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

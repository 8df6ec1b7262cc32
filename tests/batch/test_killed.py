"""kill -9 of a batch at the worst moments: gone on with, it comes to what it would have come to."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.batch import Batch, BatchPlan, LocalExecutor, Store, local_executor
from picktree.files import PicktreeError

from ..commands import PATIENCE, forked_worker
from .trouble import troubled
from .watching import Remembering

COLUMNS = "job, status, digest, attempts, items_sorted, last_tick"


def die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_within_the_second_commit(self: Any, table: str, kind: type, job: str, rows: Sequence[object]) -> None:
    if table == "failures" and len(Store.recorded(self)) == 2:
        die()
    insert(self, table, kind, job, rows)


insert = Store._insert  # pyright: ignore[reportPrivateUsage]


def run_and_be_killed(folder: Path, plan: BatchPlan, moment: str) -> None:
    if moment == "between the result and its record":
        Store.record = die  # pyright: ignore[reportAttributeAccessIssue]
    else:
        Store._insert = die_within_the_second_commit  # pyright: ignore[reportPrivateUsage]
    local_executor._started = forked_worker  # pyright: ignore[reportPrivateUsage]
    with Batch.create(folder, plan) as batch, LocalExecutor(1) as executor:
        batch.run(executor, Remembering())


def resumed(folder: Path) -> Batch:
    """Resume a batch as soon as the workers of its killed process have let go of it."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return Batch.resume(folder)
        except PicktreeError as error:
            if "another process" not in str(error) or time.monotonic() > end:
                raise
        time.sleep(0.1)


@pytest.mark.parametrize(
    ("moment", "recorded"), [("between the result and its record", 0), ("in the middle of a commit", 1)]
)
def test_a_batch_killed_at_the_worst_moment_comes_to_the_same_table(
    tmp_path: Path, workers: LocalExecutor, moment: str, recorded: int
) -> None:
    plan = BatchPlan("killed", (troubled(tmp_path, {}, picking=True),), (0, 1, 2), backend="kinematic")
    folder = tmp_path / "killed"
    process = multiprocessing.get_context("fork").Process(
        target=run_and_be_killed, args=(folder, plan, moment)
    )
    process.start()
    process.join(PATIENCE)
    assert process.exitcode == -signal.SIGKILL
    with resumed(folder) as batch:
        assert len(batch.store.recorded()) == recorded
        seen = Remembering()
        assert batch.run(workers, seen)
        # One more was done than recorded: its result is taken in, not run again.
        assert len(seen.done) == recorded + 1
        assert len(seen.ends) == 2 - recorded
        found = batch.store.query(f"SELECT {COLUMNS} FROM jobs").rows
    with Batch.create(tmp_path / "undisturbed", plan) as batch:
        assert batch.run(workers, Remembering())
        assert batch.store.query(f"SELECT {COLUMNS} FROM jobs").rows == found
    assert list(folder.glob("jobs/*")) == []

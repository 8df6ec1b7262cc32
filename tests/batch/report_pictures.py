"""The pictures of docs/batches.md: `python -m tests.batch.report_pictures FOLDER`, or `make pictures`.

Runs a batch of two grip forces, writes its page, and photographs it in headless Chromium.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from picktree.apps.batch import Batch, BatchPlan, LocalExecutor, write_report
from picktree.apps.cli.batch_progress import progress

from ..analysis.report_pictures import Shot, take

MISSION = Path(__file__).parents[2] / "examples" / "sort_by_colour.yaml"
MOST_BYTES = 200_000


SHOTS = (
    Shot("batch-report", (1280, 1440)),
    Shot(
        "batch-report-phone",
        (390, 844),
        scale=1.5,
        script="document.getElementById('choice').scrollIntoView()",
    ),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--batch", type=Path, help="of this batch instead of a new one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        page = Path(scratch) / "batch.html"
        write_report(given.batch or _run(Path(scratch) / "grip"), page, runs=0)
        take(page, given.folder, SHOTS, MOST_BYTES)


def _run(folder: Path) -> Path:
    print("32 runs of about one simulated minute, about 6 minutes of CPU")
    plan = BatchPlan(
        "grip force", (MISSION,), tuple(range(16)), settings={"Grasp.force": ("1.5 N", "30 N")}, keep="none"
    )
    with Batch.create(folder, plan) as batch, LocalExecutor() as executor, progress(folder, None) as seen:
        batch.run(executor, seen)
    return folder


if __name__ == "__main__":
    main()

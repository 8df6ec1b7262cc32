"""The pictures of docs/batches.md: `python -m tests.batch.report_pictures FOLDER`, or `make pictures`.

Runs a batch of two grip forces, writes its page, and photographs it in headless Chromium.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

from picktree.apps.batch import Batch, BatchPlan, LocalExecutor, write_report
from picktree.apps.cli.batch_progress import progress

from ..browser import Chromium

MISSION = Path(__file__).parents[2] / "examples" / "sort_by_colour.yaml"
MOST_BYTES = 200_000


@dataclass(frozen=True, slots=True)
class Shot:
    name: str
    size: tuple[int, int]
    scale: float = 1.0
    top: str = ""
    """Element that is scrolled to."""


SHOTS = (Shot("batch-report", (1280, 1440)), Shot("batch-report-phone", (390, 844), scale=1.5, top="choice"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--batch", type=Path, help="of this batch instead of a new one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        page = Path(scratch) / "batch.html"
        write_report(given.batch or _run(Path(scratch) / "grip"), page, runs=0)
        _take(page, given.folder)


def _run(folder: Path) -> Path:
    print("32 runs of about one simulated minute, about 6 minutes of CPU")
    plan = BatchPlan(
        "grip force", (MISSION,), tuple(range(16)), settings={"Grasp.force": ("1.5 N", "30 N")}, keep="none"
    )
    with Batch.create(folder, plan) as batch, LocalExecutor() as executor, progress(folder, None) as seen:
        batch.run(executor, seen)
    return folder


def _take(page: Path, folder: Path) -> None:
    browser = Chromium()
    try:
        for shot in SHOTS:
            touch = shot.size[0] < 700
            with browser.page(page, shot.size, touch=touch, scale=shot.scale) as (opened, told):
                if shot.top:
                    opened.evaluate(f"document.getElementById('{shot.top}').scrollIntoView()")
                file = folder / f"{shot.name}.png"
                opened.screenshot(path=str(file))
                print(f"{file}: {file.stat().st_size / 1e3:.0f} kB", *told.problems)
                assert file.stat().st_size < MOST_BYTES, f"{file} is too large"
    finally:
        browser.close()


if __name__ == "__main__":
    main()

"""The pictures of docs/report.md: `python -m tests.analysis.report_pictures FOLDER`, or `make pictures`.

Runs a mission in which faults are planted, writes its report, and photographs the page in headless Chromium.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from picktree.analysis import Run
from picktree.analysis.report import write_report
from picktree.session import RunRequest, Session

from ..browser import Chromium

MISSION = Path(__file__).parents[2] / "examples" / "sort_by_colour.yaml"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - fault: bump
    when: {node: Grasp, start: 2, delay: 300 ms}
    target: {nearest_to: object}
    velocity: [0.3, 0.2, 0]
  - {fault: remove, when: {node: Grasp, start: 5, delay: 500 ms}, target: {nearest_to: object}}
  - {fault: friction, when: {node: Grasp, start: 8}, target: {nearest_to: object}, friction: 0.02, mass: 0.5}
"""
MOST_BYTES = 300_000


@dataclass(frozen=True, slots=True)
class Shot:
    name: str
    size: tuple[int, int]
    at: str = ""
    dark: bool = False
    scale: float = 1.0
    script: str = ""
    """Run in the page before the picture is taken."""


CLOSE = """(() => {
  const { views } = picktreeReport.shell.panels.find((panel) => panel.name === "stage").made;
  views.chooser.value = "Follow the hand";
  views.look(views.chooser.value);
})()"""
TREE = """(() => {
  document.querySelector(".column.wide").scrollTop = document.getElementById("panel-tree").offsetTop - 330;
})()"""
SHOTS = (
    Shot("report", (1280, 860), "#t=3.9"),
    Shot("report-failure", (1280, 860), "#failure=1", script=CLOSE),
    Shot("report-dark", (1280, 860), "#failure=2", dark=True, script=TREE),
    Shot("report-phone", (390, 844), "#failure=1", scale=1.5),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--log", help="of this run instead of a new one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        page = Path(scratch) / "report.html"
        with Run(given.log or _run(Path(scratch))) as run:
            print(write_report(run, page).to_text())
        take(page, given.folder, SHOTS, MOST_BYTES)


def _run(folder: Path) -> Path:
    print("a run of about one simulated minute, about 10 s of CPU")
    faults = folder / "faults.yaml"
    faults.write_text(FAULTS, encoding="utf-8")
    return Session(RunRequest(mission=MISSION, seed=3, faults=faults, out=folder)).run().folder


def take(page: Path, folder: Path, shots: Sequence[Shot], most_bytes: int) -> None:
    browser = Chromium()
    try:
        for shot in shots:
            touch = shot.size[0] < 700
            with browser.page(page, shot.size, shot.at, dark=shot.dark, touch=touch, scale=shot.scale) as (
                opened,
                told,
            ):
                if shot.script:
                    opened.evaluate(shot.script)
                opened.wait_for_timeout(1500)  # until what is drawn bit by bit stands
                file = folder / f"{shot.name}.png"
                opened.screenshot(path=str(file))
                print(f"{file}: {file.stat().st_size / 1e3:.0f} kB", *told.problems)
                assert file.stat().st_size < most_bytes, f"{file} is too large"
    finally:
        browser.close()


if __name__ == "__main__":
    main()

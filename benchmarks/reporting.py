"""What a report of five simulated minutes weighs and costs: bytes of the page by section, seconds by packer.

The run is `sort_by_colour` with slippery items, which keep it busy until its limit.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from picktree.analysis.report.packing import pack
from picktree.analysis.report.report import PACKERS, write_report
from picktree.analysis.run import Run
from picktree.session.session import RunRequest, Session

MISSION = Path(__file__).parents[1] / "examples" / "sort_by_colour.yaml"
SLIPPERY = """\
  - fault: friction
    when: {{node: Grasp, start: {start}}}
    target: {{nearest_to: object}}
    friction: 0.02
    mass: 0.5
"""
FAULTS = "picktree: 1\nkind: faults\nfaults:\n" + "".join(SLIPPERY.format(start=n) for n in (1, 6, 12, 18))
MOST_BYTES, MOST_SECONDS = 5_000_000, 10.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--log", help="of this run instead of a new one")
    parser.add_argument("--seconds", type=float, default=300.0, help="simulated, of the new run")
    given = parser.parse_args()
    print(f"costs about {given.seconds / 10:.0f} s of CPU for the run and 15 s for two reports of it")
    with tempfile.TemporaryDirectory() as scratch:
        log = given.log or _run(Path(scratch), given.seconds)
        with Run(log) as run:
            for packer in PACKERS:
                began = time.process_time()
                section = packer(run)
                seconds = time.process_time() - began
                print(f"  {section.name:<10}{len(pack([section])) / 1e3:8.0f} kB{seconds:8.2f} s")
        began = time.process_time()
        with Run(log) as run:  # anew: what was read is not read again
            written = write_report(run, Path(scratch) / "report.html")
        seconds = time.process_time() - began
    print(
        f"{written.simulated:.0f} simulated s: {written.bytes / 1e6:.2f} MB, {seconds:.1f} s of CPU, ", end=""
    )
    print(f"{written.seconds:.1f} s of the wall clock")
    return 0 if written.bytes <= MOST_BYTES and seconds <= MOST_SECONDS else 1


def _run(folder: Path, seconds: float) -> Path:
    faults = folder / "faults.yaml"
    faults.write_text(FAULTS, encoding="utf-8")
    request = RunRequest(mission=MISSION, seed=3, faults=faults, out=folder, limit=seconds)
    return Session(request).run().folder


if __name__ == "__main__":
    raise SystemExit(main())

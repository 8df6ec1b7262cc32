"""All of motion in one command: what it costs and how often it is right, each beside a reference.

python benchmarks/motion.py                               everything
python benchmarks/motion.py --only collision,ik --runs 2000
python benchmarks/motion.py --json figures.json

Parts and what --runs counts in them:
{parts}

Times are CPU time of one thread, medians and 95th percentiles; rates come with their N and 95 % interval.
What else runs on the machine changes times, ratios less: each reference is measured in the same run.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import _motion_collision
import _motion_ik
import _motion_lines
import _motion_scenes
import _motion_timing
from _motion_tables import Part, Table

PARTS: tuple[Part, ...] = (
    _motion_collision.PART,
    _motion_ik.PART,
    _motion_lines.PART,
    _motion_scenes.PART,
    _motion_timing.PART,
)


def chosen(names: str | None) -> list[Part]:
    """The parts of that list, in the order of the benchmark. Ends the program when one is unknown."""
    if names is None:
        return list(PARTS)
    wanted = [name.strip() for name in names.split(",") if name.strip()]
    known = [part.name for part in PARTS]
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        print(
            f"--only {names}: no part {', '.join(unknown) or 'named'}; known: {', '.join(known)}",
            file=sys.stderr,
        )
        raise SystemExit(2)
    return [part for part in PARTS if part.name in wanted]


def write(file: Path, found: dict[str, list[Table]], seed: int) -> None:
    """All tables as one JSON object, whole or not at all."""
    tables = {part: [table.to_json() for table in of] for part, of in found.items()}
    beside = file.with_name(file.name + ".part")
    beside.write_text(json.dumps({"seed": seed, "parts": tables}, indent=2, ensure_ascii=False) + "\n")
    beside.replace(file)


def main(arguments: list[str] | None = None) -> int:
    listed = "\n".join(f"  {part.name:10} {part.about} ({part.runs} {part.unit})" for part in PARTS)
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__.format(parts=listed), formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", metavar="PART,…", help="these parts")
    parser.add_argument("--runs", type=int, metavar="N", help="how many, in every part")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the tables there, too")
    given = parser.parse_args(arguments)
    parts = chosen(given.only)
    if given.runs is not None and given.runs < 1:
        parser.error("--runs must be at least 1")
    if given.json is not None and not given.json.absolute().parent.is_dir():
        parser.error(f"--json {given.json}: the folder {given.json.absolute().parent} does not exist")
    runs = {part.name: given.runs or part.runs for part in parts}
    print("\n".join(part.forecast(runs[part.name]) for part in parts), flush=True)
    found: dict[str, list[Table]] = {}
    for part in parts:
        begun = time.process_time()
        found[part.name] = part.measure(runs[part.name], given.seed)
        print(f"\n== {part.name}: {part.about} ({time.process_time() - begun:.0f} s CPU)")
        for table in found[part.name]:
            print(f"\n{table.text()}", flush=True)
    if given.json is not None:
        write(given.json, found, given.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Figures of the product's source: `python -m tests.house`, or `make house`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .figures import figures, loaded_figures
from .lists import LISTS
from .source import own_house
from .table import table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.house", description=__doc__)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file; -: to stdout")
    parser.add_argument("--before", type=Path, metavar="FILE", help="print these older figures, too")
    parser.add_argument("--list", choices=LISTS, help="print what a figure counts, by file and line")
    parser.add_argument("--under", default="", metavar="PATH", help="list this folder or file only")
    given = parser.parse_args()
    house = own_house()
    if given.list:
        for entry in LISTS[given.list](house):
            if entry.file.startswith(given.under):
                print(entry)
        return
    found = figures(house) | loaded_figures(house)
    if given.json:
        text = json.dumps(found, indent=1, ensure_ascii=False) + "\n"
        if given.json == "-":
            sys.stdout.write(text)
            return
        Path(given.json).write_text(text, encoding="utf-8")
    before = json.loads(given.before.read_text(encoding="utf-8")) if given.before else None
    print(table(found, before), end="")


if __name__ == "__main__":
    try:
        main()
    except BrokenPipeError:  # as of `| head`
        sys.stderr.close()

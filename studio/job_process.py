"""Process of a job: `python -P -m picktree.studio.job_process FILE COMMAND …` runs `picktree COMMAND …`.

It writes the exit code of the command into the file, where a server that did not start it finds it.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path


def main() -> None:
    """Run the command of `sys.argv`, write its exit code, and end with it."""
    place, words = Path(sys.argv[1]), sys.argv[2:]
    sys.argv = ["picktree", *words]
    code = 3
    try:
        runpy.run_module("picktree", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    finally:
        beside = place.with_suffix(".new")
        beside.write_text(f"{code}\n", encoding="utf-8")
        beside.replace(place)
    sys.exit(code)


if __name__ == "__main__":
    main()

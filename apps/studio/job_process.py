"""Process of a job: `python -P -m picktree.apps.studio.job_process FILE COMMAND …` runs `picktree COMMAND …`.

It writes the exit code of the command into the file, where a server that did not start it finds it. It keeps
the file on stdout below `MAX_OUTPUT`.
"""

from __future__ import annotations

import os
import runpy
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

MAX_OUTPUT: Final = 10_000_000
"""Size of the output above which its beginning is left out, bytes."""
KEPT_OUTPUT: Final = 1_000_000
"""Size of the end that is then kept, bytes."""
SHORTENED: Final = f"[the output was larger than {MAX_OUTPUT // 1_000_000} MB"
"""Beginning of an output whose beginning is left out."""
_PERIOD: Final = 0.1
"""Time between two looks at the size of the output, wall s."""


def shorten(file: Path) -> None:
    """Leave out the beginning of an output that is too large. Output during the shortening may be lost."""
    if file.stat().st_size <= MAX_OUTPUT:
        return
    with file.open("r+b") as opened:
        opened.seek(-KEPT_OUTPUT, os.SEEK_END)
        part, _, lines = opened.read(KEPT_OUTPUT).partition(b"\n")
        opened.seek(0)  # others append: nothing may come before the notice
        opened.write(f"{SHORTENED}: its beginning is left out]\n".encode() + (lines or part))
        opened.truncate()


def _limit_output() -> None:
    file = Path("/proc/self/fd/1").resolve()

    def look() -> None:
        while True:
            time.sleep(_PERIOD)
            with suppress(OSError):  # a full disk; no file at all
                shorten(file)

    threading.Thread(target=look, daemon=True).start()


def main() -> None:
    """Run the command of `sys.argv`, write its exit code, and end with it."""
    place, words = Path(sys.argv[1]), sys.argv[2:]
    sys.argv = ["picktree", *words]
    _limit_output()
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

"""`python -m picktree` and the command `picktree`."""

from __future__ import annotations

import gc
import sys
from io import TextIOWrapper

from picktree.files import restart


def main() -> None:
    restart()
    # Imports make hundreds of thousands of objects that stay: looking for garbage among them costs a tenth.
    gc.set_threshold(50_000, 20, 100)
    from picktree.apps.cli import answer

    stdout: object = sys.stdout
    if isinstance(stdout, TextIOWrapper):
        stdout.reconfigure(errors="backslashreplace")  # a terminal that knows no '…' still shows the rest
    code = answer(sys.argv[1:])
    # Python looks for garbage as it ends, too, and what lives until then has none: a seventh of a check. With
    # OMPL it must look: nanobind reports on stderr what is left of its types.
    if "ompl" not in sys.modules:
        gc.freeze()
    sys.exit(code)


if __name__ == "__main__":
    main()

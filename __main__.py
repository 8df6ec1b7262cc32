"""`python -m picktree` and the command `picktree`."""

from __future__ import annotations

import sys

from .cli.app import answer


def main() -> None:
    sys.exit(answer(sys.argv[1:]))


if __name__ == "__main__":
    main()

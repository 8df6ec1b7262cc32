"""Where a command's answer goes."""

from __future__ import annotations

import os
import sys
from typing import TextIO


def keep_stdout() -> TextIO:
    """The present stdout, for the answer alone: from now on all else that is written there goes to stderr.

    Done on the file descriptor, because the libraries in C++ print on their own.
    """
    sys.stdout.flush()
    kept = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return kept

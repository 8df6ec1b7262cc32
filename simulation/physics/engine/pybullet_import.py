"""pybullet, imported without the line about its build that it writes to standard error at every start."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from contextlib import contextmanager

STANDARD_ERROR = 2
UNWANTED = b"pybullet build time"


@contextmanager
def _without_build_time() -> Generator[None]:
    """The line comes from C, past `sys.stderr`. Everything else that is written is passed on, also when the
    import fails."""
    try:
        kept = os.dup(STANDARD_ERROR)
    except OSError:
        # Nobody listens.
        yield
        return
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), STANDARD_ERROR)
        try:
            yield
        finally:
            os.dup2(kept, STANDARD_ERROR)
            os.close(kept)
            said.seek(0)
            for line in said:
                if not line.startswith(UNWANTED):
                    os.write(STANDARD_ERROR, line)


with _without_build_time():
    import pybullet as pb

__all__ = ["pb"]

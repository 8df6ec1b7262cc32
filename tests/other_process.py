"""Another process with another hash seed: what must not depend on the process is computed there, too.

It is started once for all tests, because its imports cost more than most of what is computed in it.
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

ROOT = Path(__file__).parents[1]
HASH_SEED = "77" if os.environ.get("PYTHONHASHSEED") != "77" else "78"
P = ParamSpec("P")
R = TypeVar("R")


class OtherProcess:
    """`call(function, …)` returns what a function of a test module returns in the other process."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def call(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Return the function's result there. Raises AssertionError with the traceback of what it raised."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-c", "from tests.other_process import serve; serve()"],
                cwd=ROOT,
                env={**os.environ, "PYTHONHASHSEED": HASH_SEED},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        assert self._process.stdin is not None and self._process.stdout is not None
        pickle.dump((function.__module__, function.__qualname__, args, kwargs), self._process.stdin)
        self._process.stdin.flush()
        error, result = pickle.load(self._process.stdout)
        assert not error, f"in the other process: {error}"
        return result

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()


def serve() -> None:
    """Call functions by their names until the pipe is closed. What they print goes to stderr."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            module, name, args, kwargs = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer = "", getattr(importlib.import_module(module), name)(*args, **kwargs)
        except Exception:  # noqa: BLE001 - the test that called it fails with it
            answer = traceback.format_exc(), None
        pickle.dump(answer, answers)
        answers.flush()

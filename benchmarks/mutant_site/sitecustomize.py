"""What every Python process of a mutation run does first, also those that tests start.

Python imports this module at its start from a folder in PYTHONPATH. Two variables of the environment say what
is wanted: a module from a mutated source instead of its file, or the lines that run while a test runs.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coverage import Coverage

MUTATED = "PICKTREE_MUTATED"
"""Variable: the file written by `write_mutated`."""
RECORDING = "PICKTREE_MUTANT_RECORDING"
"""Variable: the file written by `write_recording`."""
CONTEXT = "PICKTREE_MUTANT_CONTEXT"
"""Variable: the test, or the fixture of many tests, that runs now."""


class _MutatedLoader(SourceFileLoader):
    """Loader of the module at its own path, with another text; the bytecode is kept nowhere."""

    def __init__(self, name: str, path: str, text: str) -> None:
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self._text.encode(), self.get_filename(fullname))


class _MutatedFinder(MetaPathFinder):
    def __init__(self, module: str, path: str, text: str) -> None:
        self._module, self._path, self._text = module, path, text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        loader = _MutatedLoader(fullname, self._path, self._text)
        return spec_from_file_location(fullname, self._path, loader=loader)


def write_mutated(file: Path, module: str, path: Path, text: str) -> None:
    """Write down that `module` at `path` has this text."""
    file.write_text(json.dumps({"module": module, "path": str(path), "text": text}), encoding="utf-8")


def mutate() -> None:
    """Import the mutated module of the environment from now on, if there is one."""
    if file := os.environ.get(MUTATED):
        sys.meta_path.insert(0, _MutatedFinder(**json.loads(Path(file).read_text(encoding="utf-8"))))


def write_recording(file: Path, data: Path, sources: Sequence[Path]) -> None:
    """Write down that lines of `sources` are recorded, in files whose names begin with `data`."""
    file.write_text(json.dumps({"data": str(data), "include": [str(s) for s in sources]}), encoding="utf-8")


def record() -> None:
    """Record which lines run in this process, under the test that started it, if a test did."""
    if os.environ.get(CONTEXT):
        started_coverage(os.environ[CONTEXT])


def started_coverage(context: str | None = None) -> Coverage:
    """Start to record lines. `context`: the test to which the whole process belongs; None: it is switched."""
    import coverage

    wanted = json.loads(Path(os.environ[RECORDING]).read_text(encoding="utf-8"))
    cover = coverage.Coverage(
        data_file=wanted["data"], data_suffix=True, config_file=False, include=wanted["include"],
        context=context, messages=False, auto_data=True,
    )  # fmt: skip
    # A forked process ends with os._exit, which skips the saving at exit.
    cover.set_option("run:patch", ["_exit"])
    cover.start()
    return cover


if __name__ == "sitecustomize":  # imported by Python at its start, not by a program for its functions
    mutate()
    record()

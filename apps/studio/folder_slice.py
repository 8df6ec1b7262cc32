"""Folder slice: the folder's state, its files with their drafts, trust, and the examples of a first start."""

from __future__ import annotations

import asyncio
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Final

from picktree.files import PicktreeError, file_system

from .calls import JsonValue, call
from .slice import Slice, Studio

EXAMPLES: Final = file_system.ROOT / "examples"
EXAMPLE_FOLDERS: Final = ("", "cases", "faults", "plugins")
"""Folders of the examples that are copied."""
_EXAMPLE_SUFFIXES: Final = frozenset({".py", ".yaml"})


def example_files() -> list[Path]:
    """Return the paths of shipped examples below `EXAMPLES`."""
    return [
        Path(folder) / file.name
        for folder in EXAMPLE_FOLDERS
        for file in sorted((EXAMPLES / folder).glob("*"))
        if file.suffix in _EXAMPLE_SUFFIXES and file.is_file()
    ]


class FolderSlice(Slice):
    """Calls on the folder as a whole, and on its text files."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace

    @call("folder.state")
    async def state(self) -> JsonValue:
        """Return the folder's name, its trust, and its content."""
        files = await asyncio.to_thread(self._workspace.files)
        return {
            "folder": str(self._workspace.root),
            "name": self._workspace.root.name,
            "trusted": self._workspace.state.trusted,
            "files": [asdict(each) for each in files],
        }

    @call("folder.trust")
    async def trust(self, trusted: bool) -> None:
        """Allow or forbid plug-ins of missions in this folder, from now on."""
        self._workspace.state.trust(trusted)
        self._workspace.apply_trust()

    @call("folder.copy_examples")
    async def copy_examples(self) -> JsonValue:
        """Copy the examples into the folder. Files that exist stay; returns the paths that were written."""
        return await asyncio.to_thread(self._copy_examples)

    def _copy_examples(self) -> list[JsonValue]:
        written: list[JsonValue] = []
        for path in example_files():
            place = self._workspace.resolve(str(path))
            if place.exists():
                continue
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(EXAMPLES / path, place)
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                raise PicktreeError(f"{path} cannot be written: {reason}") from None
            written.append(path.as_posix())
        return written

    @call("files.list")
    async def files(self, kind: str = "") -> JsonValue:
        """Return YAML files of picktree by path, kind and name."""
        return [asdict(each) for each in await asyncio.to_thread(self._workspace.files, kind)]

    @call("files.read")
    async def read(self, path: str) -> JsonValue:
        """Return a text file with its version, and the draft of it that was not saved."""
        found = await asyncio.to_thread(self._workspace.read, path)
        return {**asdict(found), "draft": self._workspace.state.draft(path)}

    @call("files.write")
    async def write(self, path: str, text: str, version: str | None = None) -> JsonValue:
        """Write a text file; `version` is the one from `files.read`, none for a new file."""
        written = await asyncio.to_thread(self._workspace.write, path, text, version)
        self._workspace.state.keep_draft(path, None)
        return asdict(written)

    @call("files.drafted")
    async def drafted(self, path: str) -> str | None:
        """Return the unsaved text of a path; none without one."""
        return self._workspace.state.draft(path)

    @call("files.draft")
    async def draft(self, path: str, text: str | None) -> None:
        """Keep an unsaved text; none: forget it."""
        self._workspace.resolve(path)
        await asyncio.to_thread(self._workspace.state.keep_draft, path, text)

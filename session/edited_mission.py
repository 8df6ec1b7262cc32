"""Reading the mission of a running session again, after an edit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..authoring.checking.check import check_mission
from ..errors import PicktreeError
from ..files.yaml.document import Document, FileError, open_document
from ..trees.loading.scene_names import Surroundings
from ..trees.mission import Mission
from ..trees.mission_files import IN_LIBRARY
from ..trees.ports import PortDeclaration

MOST_FILES: Final = 200
"""That are watched."""


def read_edited(current: Mission, known: Surroundings, *, own_scene: bool) -> Mission:
    """The mission as its files are now. Raises FileError with the checker's errors, and PicktreeError for an
    edit that needs a new run.

    `own_scene`: the run has the scene that the mission names, not another.
    """
    check = check_mission(open_document(current.document.path, "mission"), known=known)
    errors = [fault for fault in check.faults if fault.severity == "error"]
    if errors or check.mission is None:
        raise FileError(errors)
    edited = check.mission
    if edited.library:
        raise PicktreeError(f"{edited.document.path}: this is a library now; a mission has a tree 'Main'")
    if own_scene and edited.scene != current.scene:
        message = f"the scene is {edited.scene} now, and this run has {current.scene}: that needs a new run"
        raise PicktreeError(f"{edited.document.mark(('scene',))}: {message}")
    changed = _changed(current.parameters, edited.parameters)
    if changed:
        message = f"the mission's parameter {changed!r} is another than at the start; that needs a new run"
        raise PicktreeError(f"{edited.document.mark(('trees', 'Main', 'ports'))}: {message}")
    return edited


def files_of(mission: Path) -> tuple[Path, ...]:
    """The files which, edited, make it another mission: its own, and what it includes or names as plug-in,
    be it there or not."""
    found: dict[Path, None] = {}
    todo = [mission]
    while todo and len(found) < MOST_FILES:
        file = todo.pop(0)
        if file in found:
            continue
        found[file] = None
        if file.suffix != ".py":
            try:
                todo += _named_by(open_document(file, "mission"))
            except FileError:
                continue
    return tuple(found)


def _named_by(document: Document) -> Iterator[Path]:
    folder = document.path.parent
    for key in ("include", "plugins"):
        entries = document.data.get(key)
        for entry in entries if isinstance(entries, list) else []:
            if not isinstance(entry, str) or "\x00" in entry or entry.startswith(IN_LIBRARY):
                continue
            if key == "include" or entry.endswith(".py"):
                yield folder / entry


def _changed(before: tuple[PortDeclaration, ...], after: tuple[PortDeclaration, ...]) -> str:
    """The first parameter that came, went, or takes other values; what is said about it may change."""
    old, new = ({port.key: replace(port, doc="") for port in ports} for ports in (before, after))
    return next((key for key in {**old, **new} if old.get(key) != new.get(key)), "")

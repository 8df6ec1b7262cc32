"""Edits of a mission during its run: detection of edited files, check of the new version, and messages about
it."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

from picktree.files import FileError, PicktreeError, fault_lines
from picktree.files.yaml import Document, file_text, read_document
from picktree.trees import IN_LIBRARY, Mission, PortDeclaration, runner
from picktree.trees.loading import SceneNames, scene_names
from picktree.world import event_types

from .execution import Execution
from .observer import Interrupter, ReloadMessage

MAX_WATCHED_FILES: Final = 200
"""Maximum number of files that are watched."""


def read_edited(current: Mission, known: SceneNames, *, own_scene: bool, file: Path | None = None) -> Mission:
    """Return the present mission of its files, or the mission of another file that is to replace it.

    Raises FileError with the checker's errors, and PicktreeError for an edit that needs a new run.
    `own_scene`: the run has the scene that the mission names, not another.
    """
    from picktree.authoring import check_mission  # with the linter, which no other run needs

    check = check_mission(read_document(file or current.document.path, "mission"), known=known)
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
        message = (
            f"the mission's parameter {changed!r} differs from its value at the start; such a "
            "change needs a new run"
        )
        raise PicktreeError(f"{edited.document.mark(('trees', 'Main', 'ports'))}: {message}")
    return edited


def read_replacement(run: Execution, file: Path) -> Mission:
    """Return the mission of a file that is to take over from the run's mission.

    Raises PicktreeError with what is wrong with it, all faults of the checker included.
    """
    recipe = run.recipe
    known = scene_names(recipe.scene, recipe.robot)
    try:
        return read_edited(run.mission, known, own_scene=recipe.own_scene, file=file)
    except FileError as error:
        raise PicktreeError(f"the edit is not taken over:\n{fault_lines(error.faults)}") from None
    except PicktreeError as error:
        raise PicktreeError(f"the edit is not taken over: {error}") from None


TAKEN_LATER: Final = "the edit is good; it is taken over between two items"
"""Message about an edit without errors."""


def mission_source_files(mission: Path) -> tuple[Path, ...]:
    """Return the files whose edits change the mission: its own, its includes and its plug-in files.

    A file may be missing.
    """
    found: dict[Path, None] = {}
    todo = [mission]
    while todo and len(found) < MAX_WATCHED_FILES:
        file = todo.pop(0)
        if file in found:
            continue
        found[file] = None
        if file.suffix != ".py":
            try:
                todo += _named_by(read_document(file, "mission"))
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
    """Return the first parameter that was added, removed or takes other values; empty for none.

    Changes of descriptions do not count.
    """
    old, new = ({port.key: replace(port, doc="") for port in ports} for ports in (before, after))
    return next((key for key in {**old, **new} if old.get(key) != new.get(key)), "")


FILE_POLL_PERIOD = 0.25
"""Wall seconds between two looks at the files."""
_MIN_SETTLED_AGE = 1_000_000_000
"""Age of a file, ns, from which an unchanged stamp means an unchanged content."""


class EditSource(Protocol):
    """Source of edits for a watched run, which polls it at every tick."""

    def watch(self, files: Iterable[Path]) -> None:
        """Watch these files for changes from now on. A file may be missing."""
        ...

    def found(self) -> bool:
        """Whether a file has changed since it was last watched, or since its last reported edit."""
        ...


class FileWatch:
    """Watch of files on the disk, polled a few times a second of the wall clock.

    An edit counts when two looks have seen the same content: an editor that is still writing is not
    interrupted.
    """

    def __init__(self, period: float = FILE_POLL_PERIOD, wall: Callable[[], float] = time.monotonic) -> None:
        self._period, self._wall = period, wall
        self._files: tuple[Path, ...] = ()
        self._known: dict[Path, str] = {}
        self._seen: dict[Path, str] | None = None
        self._looked_at = -period
        self._stamps: dict[Path, tuple[tuple[int, int, int], str]] = {}

    def watch(self, files: Iterable[Path]) -> None:
        self._files = tuple(dict.fromkeys(files))
        self._known, self._seen = self._look(), None

    def found(self) -> bool:
        now = self._wall()
        if now - self._looked_at < self._period:
            return False
        self._looked_at = now
        seen = self._look()
        if seen == self._known or seen != self._seen:
            self._seen = seen
            return False
        self._known, self._seen = seen, None
        return True

    def _look(self) -> dict[Path, str]:
        return {file: self._fingerprint(file) for file in self._files}

    def _fingerprint(self, file: Path) -> str:
        """Return the hash of the content; empty when the file cannot be read.

        The content is read only when the file's stamp is new.
        """
        try:
            stat = file.stat()
            stamp = (stat.st_mtime_ns, stat.st_size, stat.st_ino)
            known = self._stamps.get(file)
            if known is not None and known[0] == stamp:
                return known[1]
            fingerprint = hashlib.sha256(file.read_bytes()).hexdigest()
        except (OSError, ValueError):
            self._stamps.pop(file, None)
            return ""
        if abs(time.time_ns() - stat.st_mtime_ns) > _MIN_SETTLED_AGE:
            self._stamps[file] = (stamp, fingerprint)
        return fingerprint


class MissionReload(Interrupter):
    """Reload of a mission after an edit. `pending` is the last good edit, until it is taken over."""

    def __init__(self, edits: EditSource) -> None:
        """Watch the mission's files and the scene file, as far as `edits` reports changes of them."""
        self._edits = edits
        self._first = True

    def started(self, run: Execution, folder: Path) -> None:
        recipe = run.recipe
        self._scene = Path(recipe.scene.source)
        self._scene_content = _content(self._scene)
        self._known, self._own_scene = scene_names(recipe.scene, recipe.robot), recipe.own_scene

    def look(self, current: Mission, now: float) -> tuple[ReloadMessage, ...]:
        """Return whether an edit is good or what is wrong with it, as messages; empty without an edit. Called
        at each tick."""
        if not self._first and not self._edits.found():
            return ()
        self._first = False
        # Watch the files before reading them: an edit that comes in between is found the next time.
        self._edits.watch((*mission_source_files(current.document.path), self._scene))
        return (*self._of_the_scene(), *self._of_the_mission(current))

    def _of_the_scene(self) -> tuple[ReloadMessage, ...]:
        content = _content(self._scene)
        if content == self._scene_content:
            return ()
        self._scene_content = content
        message = f"{self._scene}: the scene was edited; this run keeps the old one, a new run has the edit"
        return (ReloadMessage(message, refused=True),)

    def _of_the_mission(self, current: Mission) -> tuple[ReloadMessage, ...]:
        if _is_on_disk(current):
            self.pending = None
            return ()
        try:
            self.pending = read_edited(current, self._known, own_scene=self._own_scene)
        except FileError as error:
            return (ReloadMessage(f"the edit is not taken over:\n{fault_lines(error.faults)}", refused=True),)
        except PicktreeError as error:
            return (ReloadMessage(f"the edit is not taken over: {error}", refused=True),)
        return (ReloadMessage(TAKEN_LATER),)


def _content(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except OSError:
        return None


def _is_on_disk(mission: Mission) -> bool:
    """Whether the mission's files are unchanged since it was read."""
    try:
        documents = (mission.document, *mission.included)
        same = all(file_text.read_text(document.path) == document.text for document in documents)
        named = [plugin for plugin in mission.sources if plugin.name.endswith(".py")]
        return same and all(p.file is not None and p.file.read_bytes() == p.source for p in named)
    except (FileError, OSError):
        return False


def mission_changed(adoption: runner.StateTransfer) -> event_types.MissionChangedEvent:
    """Return the journal event of a run that resumes with another mission."""
    message = f"another mission goes on: {adoption_summary(adoption)}"
    return event_types.MissionChangedEvent(message, fresh=tuple(adoption.fresh), gone=tuple(adoption.gone))


def adoption_summary(adoption: runner.StateTransfer) -> str:
    """Return the number of nodes that keep their state, start without one, and no longer exist, as text."""
    kept, fresh, gone = map(len, (adoption.kept, adoption.fresh, adoption.gone))
    return f"{kept} nodes go on, {fresh} begin anew, {gone} are gone"

"""Following the edits of a mission while it runs: which are good, and what is wrong with the others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ..errors import PicktreeError
from ..files.diagnostics.fault_rendering import fault_lines
from ..files.yaml.document import FileError, read_text
from ..trees.loading.scene_names import Surroundings
from ..trees.mission import Mission
from ..world.scene.description import SceneDescription
from .edited_mission import files_of, read_edited
from .file_watch import Edits


@dataclass(frozen=True, slots=True)
class News:
    """What is to be told of an edit."""

    text: str
    refused: bool = False


class Revisions(Protocol):
    """Other versions of the mission, while it runs. `pending` is the next one, until it is taken over."""

    pending: Mission | None

    def look(self, current: Mission, now: float) -> tuple[News, ...]:
        """Called before each tick, with the simulated time. Answers what is to be told."""
        ...


class Following:
    """Reads the mission again when it was edited. `pending` is the last good edit, until it is taken over."""

    def __init__(
        self, edits: Edits, scene: SceneDescription, known: Surroundings, *, own_scene: bool
    ) -> None:
        """`known` are the names of scene and robot; `own_scene`: it is the scene that the mission names."""
        self.pending: Mission | None = None
        self._edits = edits
        self._scene = Path(scene.source)
        self._scene_content = _content(self._scene)
        self._known, self._own_scene = known, own_scene
        self._first = True

    def look(self, current: Mission, now: float = 0.0) -> tuple[News, ...]:
        """To be called at each tick. Answers what is to be told: that an edit is good, or what is wrong."""
        if not self._first and not self._edits.found():
            return ()
        self._first = False
        # First the files, then their content: an edit that comes in between is found the next time.
        self._edits.watch((*files_of(current.document.path), self._scene))
        return (*self._of_the_scene(), *self._of_the_mission(current))

    def _of_the_scene(self) -> tuple[News, ...]:
        content = _content(self._scene)
        if content == self._scene_content:
            return ()
        self._scene_content = content
        message = f"{self._scene}: the scene was edited; this run keeps it as it was, a new run has the edit"
        return (News(message, refused=True),)

    def _of_the_mission(self, current: Mission) -> tuple[News, ...]:
        if _is_on_disk(current):
            self.pending = None
            return ()
        try:
            self.pending = read_edited(current, self._known, own_scene=self._own_scene)
        except FileError as error:
            return (News(f"the edit is not taken over:\n{fault_lines(error.faults)}", refused=True),)
        except PicktreeError as error:
            return (News(f"the edit is not taken over: {error}", refused=True),)
        return (News("the edit is good; it is taken over between two items"),)


def _content(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except OSError:
        return None


def _is_on_disk(mission: Mission) -> bool:
    """Whether its files are as they were when it was read."""
    try:
        documents = (mission.document, *mission.included)
        same = all(read_text(document.path) == document.text for document in documents)
        named = [plugin for plugin in mission.sources if plugin.name.endswith(".py")]
        return same and all(p.file is not None and p.file.read_bytes() == p.source for p in named)
    except (FileError, OSError):
        return False

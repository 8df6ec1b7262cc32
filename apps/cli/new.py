"""picktree new"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

import typer

from picktree.files import PicktreeError, file_system

from .output import program

StartKind: TypeAlias = Literal["mission", "scene", "plugin"]

_TEMPLATES: Final = file_system.EXAMPLES / "templates"


@dataclass(frozen=True, slots=True)
class StarterFile:
    """File of a starter: name within the folder, purpose, and the kind of file for which it is the schema."""

    name: str
    doc: str
    schema: Literal["", "mission", "scene", "cases"] = ""

    @property
    def made(self) -> bool:
        """Whether picktree generates the file, so that it has no content of the user."""
        return bool(self.schema)


@dataclass(frozen=True, slots=True)
class StarterFiles:
    """Files of a starter in reading order, and the commands to type next.

    In a command `{.}` means the folder, `{}` the path into it, MISSION a mission of the user.
    """

    parts: tuple[StarterFile, ...]
    commands: tuple[str, ...]


STARTERS: Final[Mapping[StartKind, StarterFiles]] = {
    "mission": StarterFiles(
        (
            StarterFile("mission.yaml", "the trees of nodes"),
            StarterFile("cases/mission.yaml", "what must happen when skills fail"),
            StarterFile("schemas/mission.json", "for editors: completion, explanations, errors", "mission"),
            StarterFile("schemas/cases.json", "the same for the cases", "cases"),
        ),
        (
            "check {.}",
            "render {}mission.yaml",
            "rehearse {}mission.yaml",
            "run {}mission.yaml --backend kinematic",
            "run {}mission.yaml",
        ),
    ),
    "scene": StarterFiles(
        (
            StarterFile("scene.yaml", "table, bins, camera, items, and where they belong"),
            StarterFile("schemas/scene.json", "for editors: completion, explanations, errors", "scene"),
        ),
        ("check {}scene.yaml", "run MISSION --scene {}scene.yaml --backend kinematic"),
    ),
    "plugin": StarterFiles(
        (
            StarterFile("lift.py", "the skill: its ports, its causes, what it does"),
            StarterFile("lift.yaml", "a mission that uses it"),
            StarterFile("cases/lift.yaml", "what must happen when it fails"),
            StarterFile("schemas/lift.json", "for editors, with the ports of the skill", "mission"),
            StarterFile("schemas/cases.json", "the same for the cases", "cases"),
        ),
        (
            "check {.}",
            "nodes Lift --mission {}lift.yaml",
            "rehearse {}lift.yaml",
            "run {}lift.yaml --backend kinematic",
        ),
    ),
}


def write_start(kind: StartKind, folder: Path) -> tuple[StarterFile, ...]:
    """Write the files of a starter into the folder, which is created if missing; return those written.

    Existing schemas are not changed. Raises PicktreeError, without writing anything, when another file exists
    already or one cannot be written.
    """
    for part in STARTERS[kind].parts:
        if not part.made and os.path.lexists(folder / part.name):
            raise PicktreeError(f"{folder / part.name} is there already; nothing was written")
    wanted = tuple(part for part in STARTERS[kind].parts if not os.path.lexists(folder / part.name))
    texts = {folder / part.name: _text(kind, part) for part in wanted}
    undo: list[Callable[[], None]] = []
    try:
        for path, text in texts.items():
            _make_folder(path.parent, undo)
            with path.open("x", encoding="utf-8", newline="\n") as file:
                undo.append(path.unlink)
                file.write(text)
    except OSError as error:
        for step in reversed(undo):
            step()
        why = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{error.filename or folder} cannot be written: {why}") from None
    return wanted


def _make_folder(folder: Path, undo: list[Callable[[], None]]) -> None:
    if folder.is_dir():
        return
    _make_folder(folder.parent, undo)
    folder.mkdir()
    undo.append(folder.rmdir)


def _text(kind: StartKind, part: StarterFile) -> str:
    match part.schema:
        case "":
            return (_TEMPLATES / kind / part.name).read_text(encoding="utf-8")
        case "mission":
            return _mission_schema(kind)
        case "scene" | "cases" as of:
            from picktree.authoring.schema import to_text

            from .file_schemas import file_schema

            return to_text(file_schema(of))


def _mission_schema(kind: StartKind) -> str:
    """Return the schema of missions with the installed nodes, and with those of the starter's plug-in."""
    from picktree.authoring.schema import any_mission, mission_schema, to_text
    from picktree.trees.loading import NodeRegistry

    registry = NodeRegistry()
    if kind == "plugin":
        registry.add_plugin("lift.py", _TEMPLATES / kind)
    return to_text(mission_schema(registry, any_mission()))


def new(
    kind: Annotated[Literal["mission", "scene", "plugin"], typer.Argument(help="Kind of the starter.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder; created if missing.")],
) -> None:
    """Write a commented start that passes all checks: a mission, a scene, or a skill of one's own."""
    written = write_start(kind, folder)
    widest = max(len(part.name) for part in written)
    print(f"written to {folder}:")
    for part in written:
        print(f"  {part.name.ljust(widest)}  {part.doc}")
    print("what to type next:")
    for command in STARTERS[kind].commands:
        print(f"  {program()} {_typed(command, folder)}")


def _typed(command: str, folder: Path) -> str:
    """Return the command with the folder, quoted for a shell and relative to the user's folder."""
    inside = "" if folder.resolve() == Path.cwd() else f"{folder}{os.sep}"
    known = {"{.}": str(folder)}
    if (folder / "mission.yaml").exists():
        known["MISSION"] = f"{inside}mission.yaml"
    return shlex.join(known.get(word, word.replace("{}", inside)) for word in command.split())

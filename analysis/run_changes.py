"""Changes to a recorded run before it is run again."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from picktree.authoring import check_mission
from picktree.files import Diagnostic, PicktreeError
from picktree.files.yaml import read_document
from picktree.session import run_recipe
from picktree.simulation import NominalPart, load_faults
from picktree.trees import Mission
from picktree.trees.loading import scene_names
from picktree.world import StreamVariant
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

from .run import Run

_TIME: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(s|ms|min)")
_UNITS: Final = {"s": 1.0, "ms": 1e-3, "min": 60.0}


def parse_tick(text: str, run: Run, option: str) -> int:
    """Parse a tick: `412` is the tick of that number, `20.6 s` the last tick at that simulated time or
    before.

    `option` names it in errors. Raises PicktreeError for anything else, and beyond the end of the log.
    """
    times = run.ticks.times
    if not times:
        raise PicktreeError(f"{run.path}: the log holds no tick")
    written = text.strip()
    over = f"{option} {written}: the log ends with tick {len(times) - 1}, at {times[-1]:.2f} s"
    if written.isdecimal():
        if int(written) >= len(times):
            raise PicktreeError(over)
        return int(written)
    match = _TIME.fullmatch(written)
    if match is None:
        raise PicktreeError(f"{option} {written}: write the number of a tick, as 412, or a time, as 20.6s")
    seconds = float(match[1]) * _UNITS[match[2]]
    if seconds > times[-1] + 1e-6:
        raise PicktreeError(over)
    if seconds < times[0] - 1e-6:
        raise PicktreeError(f"{option} {written}: the log begins at {times[0]:.2f} s")
    return run.ticks.number_at(seconds)


@dataclass(frozen=True, slots=True)
class RunChanges:
    """Changes to a recipe; none by default. Paths are relative to the working directory."""

    mission: Path | None = None
    scene: str | None = None
    """Shipped scene or scene file."""
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    """Parameters and ports as `--set` gives them, on top of the recorded ones."""
    faults: Path | None = None
    no_faults: bool = False
    seed: int | None = None
    nominal: tuple[str, ...] = ()
    """Parts of the simulation that no fault affects, such as `gripper` or `mass item_03`: see
    `simulation.NominalPart`."""
    variant: int | None = None
    """Number of a variant of sensor noise and planner seeds, from 1. `what_if` applies it from its time on,
    `resimulate` from the beginning."""

    def __bool__(self) -> bool:
        return self != RunChanges()


@dataclass(frozen=True, slots=True)
class ChangedRecipe:
    """Recipe with the changes applied, and texts about them."""

    recipe: run_recipe.Recipe
    told: tuple[str, ...]
    """Sentence for each change."""
    warnings: tuple[Diagnostic, ...]
    """Warnings of the checker about another mission."""
    other_tree: bool
    """Whether nodes or their ports may differ from the recorded tree."""


def apply_changes(changes: RunChanges, recorded: run_recipe.Recipe, since: float = 0.0) -> ChangedRecipe:
    """Apply the changes; noise and planner seeds differ from the time `since` on, s.

    Raises PicktreeError (FileError with all its errors for a faulty file).
    """
    recipe, sentences = recorded, list[str]()
    warnings: tuple[Diagnostic, ...] = ()
    if changes.scene is not None:
        scene = load_scene(changes.scene, Path.cwd())
        robot = load_robot(scene.robot, Path(scene.source).parent)
        recipe = replace(recipe, scene=scene, robot=robot, own_scene=False)
        sentences += _line_changes("scene", recorded.scene.text, scene.text) or ["scene: the same text"]
    if changes.mission is not None:
        mission, warnings = checked_mission(changes.mission, recipe)
        sentences += _mission_changes(recorded, mission)
        recipe = replace(recipe, mission=mission)
        if changes.scene is None and mission.scene != recorded.mission.scene:
            sentences.append(
                f"the mission names the scene {mission.scene}; this run keeps {recorded.scene.name}"
            )
    parameters, dropped = _settings(recipe, changes.settings)
    sentences += [
        f"the mission has no {name!r}, which the run had set to {dropped[name]}" for name in dropped
    ]
    for name, value in changes.settings.items():
        before = recorded.parameters.get(name)
        sentences.append(f"set {name}: {value}" + ("" if before is None else f" instead of {before}"))
    recipe = replace(recipe, parameters=parameters)
    if changes.faults is not None or changes.no_faults:
        faults = load_faults(changes.faults, recipe.scene, recipe.robot) if changes.faults else None
        recipe = replace(recipe, faults=faults)
        counts = ["none" if file is None else str(len(file.faults)) for file in (faults, recorded.faults)]
        sentences.append(f"faults: {counts[0]} instead of {counts[1]}")
    if changes.nominal:
        parts = tuple(map(NominalPart.from_words, changes.nominal))
        recipe = replace(recipe, nominal=(*recipe.nominal, *parts))
        sentences.append(f"nominal: {', '.join(each.words() for each in parts)}")
    if changes.seed is not None:
        sentences.append(f"seed {changes.seed} instead of {recorded.seed}")
        recipe = replace(recipe, seed=changes.seed)
    if changes.variant is not None:
        sentences.append(f"noise and planner seeds of variant {changes.variant} from {since:.2f} s on")
        recipe = replace(recipe, variant=StreamVariant(changes.variant, since))
    other = dict(parameters) != dict(recorded.parameters) or _texts(recipe.mission) != _texts(
        recorded.mission
    )
    return ChangedRecipe(recipe, tuple(sentences), warnings, other)


def checked_mission(path: Path, recipe: run_recipe.Recipe) -> tuple[Mission, tuple[Diagnostic, ...]]:
    """Return the mission of a file and the checker's warnings, for the recipe's scene and robot.

    Raises FileError with the checker's errors, and for a library.
    """
    known = scene_names(recipe.scene, recipe.robot)
    check = check_mission(read_document(path, "mission"), known=known)
    return check.required(), tuple(fault for fault in check.faults if fault.severity == "warning")


def _settings(recipe: run_recipe.Recipe, own: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Return all settings, and the settings of parameters that another mission does not have."""
    known = {port.key for port in recipe.mission.parameters}
    dropped = {k: v for k, v in recipe.parameters.items() if "." not in k and k not in known}
    kept = {k: v for k, v in recipe.parameters.items() if k not in dropped}
    return {**kept, **own}, dropped


def _mission_changes(recorded: run_recipe.Recipe, mission: Mission) -> Iterator[str]:
    before, after = _texts(recorded.mission), _texts(mission)
    differing = [name for name in {**before, **after} if before.get(name) != after.get(name)]
    for name in differing:
        what = "mission" if name == "mission.yaml" else f"mission, {name.partition('/')[2]}"
        yield from _line_changes(what, before.get(name, ""), after.get(name, ""))
    if not differing:
        yield "mission: the same text"


def _texts(mission: Mission) -> dict[str, str]:
    return {file.name: file.data.decode(errors="replace") for file in run_recipe.mission_files(mission)}


def _line_changes(what: str, before: str, after: str, most: int = 3) -> list[str]:
    """Return the first differing lines as text; the line numbers are those of the new text."""
    ones, others = before.splitlines(), after.splitlines()
    matcher = difflib.SequenceMatcher(None, ones, others, autojunk=False)
    blocks = [block for block in matcher.get_opcodes() if block[0] != "equal"]
    lines: list[str] = []
    for _, a, b, c, d in blocks[:most]:
        lines.append(f"{what} line {c + 1}: {_block_change(ones[a:b], others[c:d])}")
    if len(blocks) > most:
        lines.append(f"{what}: {len(blocks) - most} more places")
    return lines


def _block_change(old: Sequence[str], new: Sequence[str]) -> str:
    """Return the change of some lines as text, with the first of them."""
    if old and new:
        counts = "" if len(old) == len(new) == 1 else f"{len(new)} lines instead of {len(old)}, "
        return f"{counts}{_quoted_line(new[0])} instead of {_quoted_line(old[0])}"
    lines, fate = (new, "new") if new else (old, "gone")
    return f"{_quoted_line(lines[0])} is {fate}" if len(lines) == 1 else f"{len(lines)} lines are {fate}"


def _quoted_line(text: str) -> str:
    line = " ".join(text.split())
    return f"`{line if len(line) <= 60 else line[:59] + '…'}`"

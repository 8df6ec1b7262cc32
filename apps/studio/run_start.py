"""Start of a run from the page: what a mission offers, and the command that runs it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from ...files.errors import PicktreeError
from ...trees.loading.loader import load_mission
from ...trees.loading.registry import NodeRegistry
from ...trees.port_types import show
from ...trees.ports import PortDeclaration
from ...world.robot_model.loading import robot_names
from ...world.scene.scene_loading import scene_names
from .calls import JsonValue
from .workspace import Workspace

MAX_SEED: Final = 2**31 - 1


class RunOrder(BaseModel):
    """Order for a run, as the page's form has it. Paths are below the folder."""

    model_config = ConfigDict(extra="forbid", strict=True)

    mission: str
    scene: str = ""
    """Shipped scene or scene file; empty: the mission's own."""
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 0
    parameters: Mapping[str, str] = Field(default_factory=dict[str, str])
    robot: str = ""
    """Shipped robot or robot file; empty: the scene's."""
    faults: str = ""
    backend: Literal["physics", "kinematic"] = "physics"
    pace: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Bound of simulated seconds per wall second; 0: as fast as possible."""
    watch: bool = True
    """Whether edits of the mission take over between two items."""


def start_form(workspace: Workspace, mission: str) -> JsonValue:
    """Return what a mission and the folder offer for a run. Raises PicktreeError, with the faults of the
    file."""
    loaded = load_mission(workspace.resolve(mission), NodeRegistry())
    files = workspace.files()
    return {
        "mission": mission,
        "scene": loaded.scene or "",
        "parameters": [_parameter(port) for port in loaded.parameters],
        "scenes": [*scene_names(), *(each.path for each in files if each.kind == "scene")],
        "robots": [*robot_names(), *(each.path for each in files if each.kind == "robot")],
        "faults": [each.path for each in files if each.kind == "faults"],
    }


def _parameter(port: PortDeclaration) -> JsonValue:
    return {
        "name": port.key,
        "type": str(port.type),
        "unit": port.unit or "",
        "doc": port.doc,
        "required": port.required,
        "default": "" if port.required or port.default is None else show(port.default).strip("'"),
        "choices": [str(choice) for choice in port.choices or ()],
    }


def run_command(workspace: Workspace, order: RunOrder, runs: Path) -> list[str]:
    """Return the words after `picktree` for an order. Raises PicktreeError for a path outside the folder."""
    words = ["run", str(workspace.resolve(order.mission)), "--out", str(runs), "--seed", str(order.seed)]
    words += ["--backend", order.backend]
    if order.scene:
        words += ["--scene", _named(workspace, order.scene, scene_names())]
    if order.robot:
        words += ["--robot", _named(workspace, order.robot, robot_names())]
    if order.faults:
        words += ["--faults", str(workspace.resolve(order.faults))]
    if order.pace > 0.0:
        words += ["--pace", f"{order.pace:g}"]
    words.append("--wait")  # a question waits for the page, also while no server is there
    if order.watch:
        words.append("--watch")
    for name, value in order.parameters.items():
        if "=" in name or name.startswith("-"):
            raise PicktreeError(f"{name!r} is no name of a parameter")
        words += ["--set", f"{name}={value}"]
    return words


def _named(workspace: Workspace, name: str, shipped: tuple[str, ...]) -> str:
    """Return a shipped name as it is, a file below the folder as its path."""
    if name in shipped:
        return name
    with suppress(PicktreeError):
        place = workspace.resolve(name)
        if place.is_file():
            return str(place)
    raise PicktreeError(f"{name!r} is neither shipped nor a file of the folder")

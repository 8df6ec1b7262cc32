"""Names that scene and robot define for a mission: cameras, bins, kinds, named poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...robots.description import RobotDescription
from ...robots.loading import load_robot
from ...world.scene.description import SceneDescription
from ...world.scene.loading.scene_loading import load_scene
from ..ports import NameKind


@dataclass(frozen=True, slots=True)
class SceneNames:
    """Names that a mission may use, by kind of name; `scene` and `robot` are the sources."""

    scene: str
    robot: str
    names: Mapping[NameKind, tuple[str, ...]]


def load_surroundings(name: str, beside: Path | None = None) -> SceneNames:
    """Load the names of a shipped scene, or of a scene file relative to `beside`, and of its robot.

    Raises FileError for a faulty file, PicktreeError when there is none.
    """
    scene = load_scene(name, beside)
    return scene_names(scene, load_robot(scene.robot, Path(scene.source).parent))


def scene_names(scene: SceneDescription, robot: RobotDescription) -> SceneNames:
    """Return the names that the scene and the robot define."""
    bins = tuple(str(body.id) for body in scene.bins)
    colours = dict.fromkeys(colour for entry in scene.loads for colour in entry.colours)
    bored = [fixture for fixture in scene.fixtures if fixture.holes]
    names: dict[NameKind, tuple[str, ...]] = {
        "camera": tuple(camera.name for camera in scene.cameras),
        "pose": tuple(robot.named),
        "bin": bins,
        "hole": tuple(str(each.id) for fixture in bored for each in (fixture, *fixture.holes)),
        "fixture": (*(str(fixture.id) for fixture in scene.fixtures), *bins),
        "kind": tuple(entry.kind for entry in scene.catalogue),
        "colour": tuple(colours),
    }
    return SceneNames(scene.name, robot.name, names)

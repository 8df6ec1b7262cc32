"""The files of a recipe as a log keeps them, enough to make the recipe again from the log alone."""

from __future__ import annotations

import hashlib
import posixpath
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

from ..files.yaml.document import read_document
from ..robots.description import RobotDescription
from ..robots.mesh_files import mesh_file
from ..robots.urdf_geometry import LinkMesh, link_geometry
from ..world.scene.description import SceneDescription
from ..world.shapes import ConvexMesh
from .mission_files import Attachment, mission_files
from .recipe import Recipe

ROBOT_MESHES: Final = "robot/"
"""Where the meshes that a URDF names stand, each under the name that it has there."""


def recipe_files(recipe: Recipe) -> Iterator[Attachment]:
    """Mission, scene, robot and faults, with what they name.

    The meshes of a robot whose URDF is in an installed package are not among them: see `installed_meshes`.
    """
    yield from mission_files(recipe.mission)
    scene, robot = recipe.scene, recipe.robot
    yield Attachment("scene.yaml", scene.text, "application/yaml", Path(scene.source))
    yield from scene_meshes(scene)
    urdf = Path(robot.urdf)
    yield Attachment("robot.yaml", robot.text, "application/yaml", Path(robot.source))
    yield Attachment("robot.urdf", urdf.read_bytes(), "application/xml", urdf)
    if not is_installed(robot):
        for name, file in robot_meshes(robot.urdf):
            yield Attachment(name, file.read_bytes(), "model/mesh", file)
    if recipe.faults is not None:
        faults = recipe.faults
        yield Attachment("faults.yaml", faults.text, "application/yaml", Path(faults.source))


def fingerprints(recipe: Recipe, files: Iterator[Attachment] | list[Attachment]) -> dict[str, str]:
    """SHA-256 and original path of each file, by the name that it has in the log."""
    found = {
        file.name: f"{hashlib.sha256(file.data).hexdigest()} {recipe.paths.get(file.name, file.source or '')}"
        for file in files
    }
    return {**found, **installed_meshes(recipe.robot)}


def scene_meshes(scene: SceneDescription) -> Iterator[Attachment]:
    """The meshes of the catalogue: `mesh/hexagon.obj`; with the kind before it where two have one name."""
    files = {e.kind: Path(e.shape.source) for e in scene.catalogue if isinstance(e.shape, ConvexMesh)}
    named = Counter(file.name for file in set(files.values()))
    given: set[str] = set()
    for kind, file in files.items():
        name = f"mesh/{file.name}" if named[file.name] == 1 else f"mesh/{kind}/{file.name}"
        if name not in given:
            given.add(name)
            yield Attachment(name, file.read_bytes(), "model/mesh", file)


def installed_meshes(robot: RobotDescription) -> Mapping[str, str]:
    """As `fingerprints`, of the meshes of a robot that comes with an installed package."""
    return _hashed_meshes(robot.urdf) if is_installed(robot) else {}


def is_installed(robot: RobotDescription) -> bool:
    """Whether its URDF, and that of a mounted gripper, are named as `package:path`."""
    data = read_document(robot.text, Path(robot.source), "robot").data
    mount = data.get("mount")
    named = [str(data.get("urdf"))]
    if isinstance(mount, dict):
        named.append(str(mount.get("urdf")))
    return all(":" in each for each in named)


def robot_meshes(urdf: str) -> tuple[tuple[str, Path], ...]:
    """All meshes that a URDF names, visual and collision, each once: name in the log, file."""
    named = dict(_references(urdf))
    found = [*link_geometry(urdf, "visual"), *link_geometry(urdf, "collision")]
    files = {g.path: Path(g.path) for g in found if isinstance(g, LinkMesh)}
    return tuple((named[path], file) for path, file in sorted(files.items()) if path in named)


def plain_reference(filename: str) -> str:
    """The name of a mesh in a URDF as a path that leads nowhere else."""
    for prefix in ("package://", "file://"):
        filename = filename.removeprefix(prefix)
    parts = [p for p in posixpath.normpath(filename.replace("\\", "/")).split("/") if p not in ("", ".")]
    return "/".join("up" if part == ".." else part for part in parts)


def _references(urdf: str) -> Iterator[tuple[str, str]]:
    for mesh in ElementTree.parse(urdf).getroot().iter("mesh"):
        filename = mesh.get("filename", "")
        if (file := mesh_file(Path(urdf), filename)) is not None:
            yield str(file), f"{ROBOT_MESHES}{plain_reference(filename)}"


@lru_cache(maxsize=4)
def _hashed_meshes(urdf: str) -> Mapping[str, str]:
    return {
        name: f"{hashlib.sha256(file.read_bytes()).hexdigest()} {file}" for name, file in robot_meshes(urdf)
    }

"""A scene together with its robot."""

from __future__ import annotations

from ..files.yaml.document import Document, Fault, FileError, open_document
from ..world.scene.loading.scene_loading import check_scene
from .loading import check_robot


def check_cell(document: Document) -> tuple[Fault, ...]:
    """Everything that can be said of a document of kind `scene`, and of the robot file that it names."""
    scene = check_scene(document)
    if scene.robot is None:
        return scene.faults
    try:
        return (*scene.faults, *check_robot(open_document(scene.robot, "robot")).faults)
    except FileError as error:
        return (*scene.faults, *error.faults)

"""Conversion of files to the other form, mission or XML."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from picktree.files import FileError, PicktreeError, file_system
from picktree.files.yaml import file_text, read_document
from picktree.trees.loading import NodeRegistry, examine

from .mission_export import mission_to_xml
from .mission_import import ImportedMission, ImportOptions, import_xml
from .source import XmlText

_TREES = re.compile(r"<BehaviorTree\b|<TreeNodesModel\b")


def convert_text(text: str, path: Path, registry: NodeRegistry | None = None) -> str:
    """Convert a mission to XML, or XML to a mission. Raises FileError with all errors of the text."""
    if is_xml(text):
        return import_xml([XmlText(text, path)], registry).text
    reading = examine(read_document(path, "mission", text), registry)
    if any(fault.severity == "error" for fault in reading.faults):
        raise FileError(reading.faults)
    return mission_to_xml(reading.mission)


def convert_all(
    files: Sequence[XmlText], options: ImportOptions, registry: NodeRegistry | None = None
) -> ImportedMission:
    """Convert one mission, or XML files that belong together.

    Raises FileError with all errors, PicktreeError for several files of which one is no XML.
    """
    missions = [file for file in files if not is_xml(file.text)]
    if not missions:
        return import_xml(files, registry, options)
    if len(files) > 1:
        raise PicktreeError(f"{missions[0].path} is no XML: several files are read together only as XML")
    return ImportedMission(convert_text(files[0].text, files[0].path, registry), ())


def is_xml(text: str) -> bool:
    """Whether a text is XML rather than a mission."""
    return text.lstrip().startswith("<")


def read_files(paths: Sequence[Path]) -> list[XmlText]:
    """Read files, and of folders all XML files with trees, in the order of their names. Raises FileError."""
    found: dict[str, XmlText] = {}
    for path in paths:
        inside = (
            list(_trees_in(path))
            if file_system.is_folder(path)
            else [XmlText(file_text.read_text(path), path)]
        )
        if not inside:
            raise PicktreeError(f"there is no XML file with trees in the folder {path}")
        for each in inside:
            found.setdefault(os.path.abspath(each.path), each)
    return list(found.values())


def _trees_in(folder: Path) -> Iterator[XmlText]:
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            if name.endswith(".xml") and not name.startswith("."):
                path = Path(parent, name)
                text = file_text.read_text(path)
                if _TREES.search(text):
                    yield XmlText(text, path)

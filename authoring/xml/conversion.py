"""Conversion of a file to the other form, mission or XML."""

from __future__ import annotations

from pathlib import Path

from ...files.marks import FileError
from ...files.yaml.document import read_document
from ...files.yaml.file_text import read_text
from ...trees.loading.loader import examine
from ...trees.loading.registry import NodeRegistry
from .export.mission_export import mission_to_xml
from .importing.mission_import import xml_to_mission


def convert(path: Path, registry: NodeRegistry | None = None) -> str:
    """Convert a mission file to XML, or an XML file to a mission. Raises FileError with all its errors."""
    return convert_text(read_text(path), path, registry)


def convert_text(text: str, path: Path, registry: NodeRegistry | None = None) -> str:
    """Convert a text as `convert` converts a file."""
    if text.lstrip().startswith("<"):
        return xml_to_mission(text, path, registry)
    reading = examine(read_document(path, "mission", text), registry)
    if any(fault.severity == "error" for fault in reading.faults):
        raise FileError(reading.faults)
    return mission_to_xml(reading.mission)

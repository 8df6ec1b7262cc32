"""Context of a mission schema: names and sub-trees known for any mission, or for one given file.

Schema of patch files, which are merged into another file of their kind: nothing is required, null
removes.
"""

from __future__ import annotations

from typing import cast

from ...files.errors import PicktreeError
from ...files.yaml.document import Document
from ...trees.fault_collector import MissionDiagnostics
from ...trees.loading.loader import SceneNames, load_surroundings
from ...trees.loading.registry import NodeRegistry
from ...trees.loading.tree_ports import TreePorts
from ...trees.loading.tree_set import IncludeReader
from ...trees.mission import FilesOnDisk, MissionFiles
from ...trees.ports import NameKind, PortDeclaration
from ...world.planner_names import planner_names
from ...world.scene.scene_loading import scene_names
from .mission_schema import MissionSpecifics
from .port_schema import ProposedNames
from .schema_parts import NULL, Schema, ref, schema, schemas


def patch(full: Schema) -> Schema:
    """Return the schema of a patch for values with the schema `full` (RFC 7396).

    Lists are replaced as a whole, so their content is not partial.
    """
    found: Schema = {}
    for key, value in full.items():
        match key:
            case "required" | "minProperties":
                pass
            case "$ref":
                name = str(value).rpartition("/")[2]
                return {"anyOf": [ref(patched(name)), NULL]}
            case "properties":
                found[key] = {name: patch(schema(part)) for name, part in schema(value).items()}
            case "additionalProperties" if value not in (True, False):
                found[key] = patch(schema(value))
            case "anyOf" | "allOf":
                # Rules over several keys hold for the merged whole only.
                parts = [patch(part) for part in schemas(value) if "if" not in part]
                found |= {key: parts} if parts else {}
            case "markdownDescription":
                # The base scene may supply a required key.
                found[key] = str(value).replace("; required*", "*").replace("\n\n*required*", "")
            case "type":
                found[key] = _with_null(value)
            case "enum" if isinstance(value, list):
                found[key] = [*value, *([] if None in value else [None])]
            case _:
                found[key] = value
    return found


def patched(name: str) -> str:
    return f"{name}Patch"


def _with_null(kinds: object) -> list[object]:
    names: list[object] = [*cast("list[object]", kinds)] if isinstance(kinds, list) else [kinds]
    return names if "null" in names else [*names, "null"]


def any_mission() -> MissionSpecifics:
    """Return the context of any mission: names of the shipped scenes as proposals, others allowed."""
    names: dict[NameKind, dict[str, None]] = {}
    for scene in scene_names():
        for kind, found in load_surroundings(scene).names.items():
            names.setdefault(kind, {}).update(dict.fromkeys(found))
    return MissionSpecifics(
        scenes=scene_names(), known=ProposedNames({kind: tuple(found) for kind, found in names.items()})
    )


def one_mission(
    document: Document, registry: NodeRegistry, files: MissionFiles | None = None
) -> MissionSpecifics:
    """Return the context of one mission file, which may be faulty. Nodes of its plug-ins join the registry.

    Raises PicktreeError for a plug-in that fails.
    """
    trees: dict[str, tuple[PortDeclaration, ...]] = {}
    docs: dict[str, str] = {}
    for file in mission_files(document, files):
        plugins = file.data.get("plugins")
        for plugin in plugins if isinstance(plugins, list) else []:
            if isinstance(plugin, str) and plugin:
                registry.add_plugin(plugin, file.path.parent)
        bodies = file.data.get("trees")
        declared = TreePorts(file, MissionDiagnostics())
        for name, body in (bodies if isinstance(bodies, dict) else {}).items():
            trees[name] = declared.of(name, body)
            docs[name] = declared.doc(name, body)
    # A tree with the name of a node is an error, and no tree.
    trees = {name: ports for name, ports in trees.items() if registry.find(name) is None}
    known = _known(document)
    names = ProposedNames({**known.names, "planner": planner_names()}, all=True) if known else ProposedNames()
    return MissionSpecifics(True, scene_names(), trees, names, docs)


def mission_files(document: Document, files: MissionFiles | None = None) -> tuple[Document, ...]:
    """Return a mission, and the files that it includes as far as they can be read.

    `files`: source of the included files, by default the disk.
    """
    beside = files or FilesOnDisk(document.path.parent)
    return (document, *IncludeReader(beside, MissionDiagnostics()).of(document))


def _known(document: Document) -> SceneNames | None:
    scene = document.data.get("scene")
    if not isinstance(scene, str) or not scene:
        return None
    try:
        return load_surroundings(scene, document.path.parent)
    except PicktreeError:
        return None

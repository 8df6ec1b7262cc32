"""Schema of mission files: of all missions, or of one with known names, sub-trees, plug-ins and scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import cast

from picktree.files import PicktreeError
from picktree.files.yaml import Document
from picktree.trees import (
    MAIN,
    NAMES_IN_FILES,
    FilesOnDisk,
    MissionDiagnostics,
    MissionFiles,
    NameKind,
    PortDeclaration,
)
from picktree.trees.loading import IncludeReader, NodeRegistry, SceneNames, TreePorts, load_surroundings
from picktree.world import OUR_PREFIXES, Cause, planner_names
from picktree.world.scene import scene_loading

from .node_reference import required_one_of
from .node_schema import (
    NodeIds,
    ProposedNames,
    bare_docs,
    common_definitions,
    common_properties,
    needs_body,
    node_schema,
    tree_schema,
)
from .schema_parts import DRAFT, ID_PATTERN, NULL, Schema, escaped, header, if_bare, ref, schema, schemas


def causes_schema(causes: Iterable[Cause], patterns: Iterable[str], *, closed: bool) -> Schema:
    """Return the schema of a cause table. `patterns`: names of causes, families and `*`.

    `closed`: there are no other causes.
    """
    known = {cause.name: cause for cause in causes}
    properties: dict[str, Schema] = {}
    for pattern in patterns:
        cause = known.get(pattern)
        properties[pattern] = _handler(
            f"{cause.sentence} First remedy: {cause.remedy}." if cause else _family(pattern, known)
        )
    found: Schema = {"type": "object", "minProperties": 1, "properties": properties}
    if closed:
        return found | {"additionalProperties": False}
    own = "|".join(map(escaped, OUR_PREFIXES))
    foreign = rf"^(?!(?:{own})\.)[a-z][A-Za-z0-9_]*(?:\.[a-z][A-Za-z0-9_]*)*(?:\.\*)?(?![\s\S])"
    return found | {"patternProperties": {foreign: ref("child")}, "additionalProperties": False}


def _family(pattern: str, known: Iterable[str]) -> str:
    if pattern == "*":
        return "Every cause but `internal.error`, a fault of the program."
    return "Any of " + ", ".join(f"`{name}`" for name in known if name.startswith(pattern[:-1])) + "."


def _handler(markdown: str) -> Schema:
    docs: Schema = {"description": markdown.replace("`", ""), "markdownDescription": markdown}
    # First, so that the cause is explained and not the node that handles it.
    return {"allOf": [docs, ref("child")]} | docs


_TYPES = (*NAMES_IN_FILES, *(f"list of {name}" for name in NAMES_IN_FILES))


@dataclass(frozen=True, slots=True)
class MissionSpecifics:
    """Known specifics of a mission: sub-trees with their ports, and names of its scene and robot.

    closed: there are no other sub-trees, nodes and causes than those that are known.
    """

    closed: bool = False
    scenes: tuple[str, ...] = ()
    """Scenes that come with picktree."""
    trees: Mapping[str, tuple[PortDeclaration, ...]] = field(
        default_factory=dict[str, "tuple[PortDeclaration, ...]"]
    )
    known: ProposedNames = field(default_factory=ProposedNames)
    docs: Mapping[str, str] = field(default_factory=dict[str, str])
    """Texts under `doc` of the sub-trees, by name."""


def mission_schema(registry: NodeRegistry, particular: MissionSpecifics) -> Schema:
    """Return the JSON Schema of a mission that may use the registry's nodes."""
    declared = registry.declarations()
    classes = {name: node for name in registry.ids() if (node := registry.find(name)) is not None}
    together = {name: required_one_of(node) for name, node in classes.items()}
    needing = [node.id for node in declared if needs_body(node, together[node.id])]
    needing += [name for name, ports in particular.trees.items() if any(p.required for p in ports)]
    ids = NodeIds(
        tuple(node.id for node in declared), tuple(particular.trees), tuple(needing), particular.closed
    )
    single = ids.single()
    definitions: dict[str, Schema] = {
        "tree": _tree(ids),
        "treePort": _tree_port(),
        "node": single,
        "child": single | {"type": ["object", "array", "string"], "items": ref("node"), "minItems": 1},
        "bare": {"title": "node"}
        | ids.bare()
        | bare_docs(node for node in declared if node.id not in needing),
        "unknown": {"properties": common_properties()},
        "causes": causes_schema(registry.causes, registry.patterns, closed=ids.closed),
        **common_definitions(),
        **{
            f"node.{node.id}": node_schema(node, together[node.id], ids, particular.known)
            for node in declared
        },
        **{
            f"tree.{name}": tree_schema(name, ports, particular.known, particular.docs.get(name, ""))
            for name, ports in particular.trees.items()
        },
    }
    return {
        "$schema": DRAFT,
        "title": "picktree mission",
        "description": "A mission: behaviour trees that say what the robot does, and what may cure failures.",
        "type": "object",
        "properties": _head(particular.scenes) | {"trees": _trees()},
        "required": ["picktree", "kind", "trees"],
        "additionalProperties": False,
        "if": {"properties": {"library": {"const": True}}, "required": ["library"]},
        "then": {"properties": {"scene": False, "goal": False}},
        "else": {"properties": {"trees": {"required": [MAIN]}}},
        "definitions": definitions,
    }


def _head(scenes: tuple[str, ...]) -> dict[str, Schema]:
    found: dict[str, Schema] = {
        "name": {
            "type": ["string", "null"],
            "minLength": 1,
            "description": "Name of the mission in results and reports. Default: the file's name.",
        },
        "scene": {
            "type": ["string", "null"],
            "minLength": 1,
            "description": "Scene of the mission: a shipped scene, or a scene file beside this one.",
            "examples": list(scenes),
        },
        "goal": {
            "type": ["string", "null"],
            "minLength": 1,
            "description": "Condition for a successful run, besides the root's SUCCESS: an expression of the "
            "numbers of items total, sorted, misplaced, left and outstanding (those that a feed still owes). "
            "Default: every item at its destination and none outstanding.",
            "examples": ["misplaced == 0 and left <= 1"],
        },
        "library": {
            "type": ["boolean", "null"],
            "description": "True for a file with sub-trees for others to include, and no 'Main'.",
        },
        "include": {
            "type": ["array", "null"],
            "items": {"type": "string", "minLength": 1},
            "description": "Files whose trees are used here: files next to this file, or 'library/recovery' "
            "from the "
            "built-in library.",
        },
        "plugins": {
            "type": ["array", "null"],
            "items": {"type": "string", "minLength": 1},
            "description": "Modules, or Python files beside this one, that bring nodes of your own.",
        },
    }
    return header("mission") | found


def _trees() -> Schema:
    message = "a tree's ID is a letter or '_', then letters, digits and '_'"
    return {
        "type": "object",
        "description": "The trees by name. A run ticks 'Main'; the others are used as nodes by their names.",
        "propertyNames": {
            "title": "SubTree",
            "description": "A tree of your own, used as a node by its name.",
            "pattern": ID_PATTERN,
            "patternErrorMessage": message,
        },
        "properties": {
            MAIN: {
                "allOf": [ref("tree")],
                "description": "The tree that a run ticks. Its ports "
                "are the mission's parameters: `picktree run --set name=value`.",
            }
        },
        "additionalProperties": ref("tree"),
    }


def _tree(ids: NodeIds) -> Schema:
    ports: Schema = {
        "type": ["object", "null"],
        "description": "Ports of the tree by name: type, default, unit, documentation.",
        "propertyNames": {
            "pattern": r"^(?!(?:name|breakpoint)(?![\s\S]))[A-Za-z][A-Za-z0-9_]*(?![\s\S])",
            "patternErrorMessage": "a port's name is a letter, then letters, digits and '_'",
        },
        "additionalProperties": ref("treePort"),
    }
    doc: Schema = {"type": "string", "description": "The tree in a sentence or two, for people."}
    return {
        "type": ["object", "string"],
        "properties": ids.properties() | {"doc": doc, "ports": ports},
        "if": {"type": "object", "required": ["ports"]},
        "then": _one_more_with_doc(2),
        "else": _one_more_with_doc(1),
        "allOf": [if_bare()],
    } | ids.others()


def _one_more_with_doc(keys: int) -> Schema:
    """Return the rule for this number of keys, and one more with `doc`."""
    return {
        "if": {"type": "object", "required": ["doc"]},
        "then": {"minProperties": keys + 1, "maxProperties": keys + 1},
        "else": {"minProperties": keys, "maxProperties": keys},
    }


def _tree_port() -> Schema:
    types = "|".join(_TYPES)
    return {
        "type": ["object", "string"],
        "pattern": rf"^(?:{types})(?![\s\S])",
        "patternErrorMessage": f"a type is one of {', '.join(_TYPES)}",
        "description": "A port of this tree; a bare text is its type.",
        "properties": {
            "type": {
                "enum": list(_TYPES),
                "description": "Type of the port; 'object' is the id of an object.",
            },
            "default": {
                "description": "Value when the caller gives none; without a default the port must be given."
            },
            "doc": {
                "type": "string",
                "description": "Description in one line: the meaning of the port, and of 0 or -1.",
            },
            "unit": {
                "type": "string",
                "description": 'Unit of a number: a value may then be written with a unit, as "30 mm".',
                "examples": ["m", "rad", "s", "ms", "N"],
            },
            "choices": {"type": "array", "description": "The only values allowed."},
            "direction": {
                "enum": ["in", "out"],
                "description": "'out': the tree writes it. Default: 'in'.",
            },
        },
        "additionalProperties": False,
    }


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
    for scene in scene_loading.scene_names():
        for kind, found in load_surroundings(scene).names.items():
            names.setdefault(kind, {}).update(dict.fromkeys(found))
    return MissionSpecifics(
        scenes=scene_loading.scene_names(),
        known=ProposedNames({kind: tuple(found) for kind, found in names.items()}),
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
    names = (
        ProposedNames({**known.names, "planner": planner_names.planner_names()}, all=True)
        if known
        else ProposedNames()
    )
    return MissionSpecifics(True, scene_loading.scene_names(), trees, names, docs)


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

"""Loader of missions: mission file to Mission, with the trees that it includes. All errors of the text
are found and reported together.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from graphlib import CycleError
from pathlib import Path
from typing import Final, Literal

from picktree.files import (
    INT,
    Diagnostic,
    Expression,
    FileError,
    Location,
    PicktreeError,
    ValueType,
    check_types,
    expression_syntax,
    suggest_name,
    where,
)
from picktree.files.yaml import Document, Value, read_document
from picktree.trees import (
    AUTOREMAP,
    IDENTIFIER,
    IN_LIBRARY,
    MAIN,
    FilesOnDisk,
    Mission,
    MissionDiagnostics,
    MissionFiles,
    NameKind,
    Node,
    NodeSpec,
    PortDeclaration,
    PortType,
    TreeSpec,
    bottom_up,
    check_calls,
    data_flow,
    expression_faults,
    references,
    show,
    unlike_comparisons,
    wiring_faults,
)
from picktree.world import heap_geometry, planner_names, world_facts
from picktree.world.robot_model import RobotDescription, load_robot
from picktree.world.scene import SceneDescription, load_scene

from .grammar import ChildNames, NodeSpecReader
from .plugin_import import PluginError
from .port_reader import TreePorts
from .registry import NodeRegistry

MAX_INCLUDED_FILES: Final = 50
MAX_INCLUDED_CHARACTERS: Final = 1_000_000
"""Limit of the total size of all included files, characters."""
_SUFFIXES = (".yaml", ".yml")


def remap_keys(trees: dict[str, TreeSpec]) -> dict[str, TreeSpec]:
    """Wire the calls with `_autoremap`: each key that a sub-tree uses becomes a port, wired to the same key.

    Keys that begin with `_` stay the sub-tree's own, as in BehaviorTree.CPP.
    """
    calls = [spec for tree in trees.values() for spec in tree.root.iterate() if spec.node is None]
    remapped = {spec.id for spec in calls if spec.autoremap is not None}
    if not remapped:
        return trees
    try:
        order = bottom_up(trees)
    except CycleError:
        return trees  # a fault already
    done = dict(trees)
    for name in order:
        tree = replace(done[name], root=_remapping(done[name].root, done))
        if name in remapped:
            tree = replace(tree, ports=(*tree.ports, *_shared_keys(tree, done)))
        done[name] = tree
    return {name: done[name] for name in trees}


def _remapping(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> NodeSpec:
    """Return the node with all calls below it wired."""
    slots = {
        key: tuple((label, _remapping(child, trees)) for label, child in filled)
        for key, filled in spec.slots.items()
    }
    if spec.autoremap is None or spec.id not in trees:
        return replace(spec, slots=slots) if slots else spec
    same = {
        port.key: references.Reference(port.key)
        for port in trees[spec.id].ports
        if port.key not in spec.ports
    }
    return replace(spec, ports={**spec.ports, **same}, autoremap=frozenset(same))


def _shared_keys(tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[PortDeclaration]:
    """Yield a port for each key of the tree that is not one of its ports."""
    uses = [use for spec in tree.root.iterate() for use in data_flow.uses_of(spec, trees)]
    written = {use.key for use in uses if use.writes}
    ports = {port.key for port in tree.ports}
    for key in dict.fromkeys(use.key for use in uses):
        if (
            key not in ports
            and not key.startswith(("_", references.ROOT_KEY))
            and (key in written or key not in world_facts.FACTS)
        ):
            way: Literal["in", "out"] = "out" if key in written else "in"
            yield PortDeclaration(key, key, way, PortType("any"), "", remapped=True)


def _unshared(tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[Diagnostic]:
    """Yield a fault for each key that a call without `_autoremap` does not give."""
    for spec in tree.root.iterate():
        if spec.node is None and spec.autoremap is None and spec.id in trees:
            for port in trees[spec.id].ports:
                if port.remapped and port.direction == "in":
                    message = (
                        f"{spec.id} reads the key {port.key!r} of its caller, which this call does not share"
                    )
                    hint = f"add '{AUTOREMAP}: true' to the call, or give {spec.id} the port {port.key!r}"
                    yield Diagnostic(spec.mark, f"trees.{tree.name}", message, hint, "P219")


class IncludeReader:
    """Reader that follows `include:` from the mission through all its files."""

    def __init__(self, files: MissionFiles, faults: MissionDiagnostics) -> None:
        self._files = files
        self._faults = faults
        self._found: dict[str, Document | None] = {}
        self._characters = 0

    def of(self, document: Document) -> tuple[Document, ...]:
        """Return the files that the mission includes, each once, in the order of their first mention."""
        self._follow(document, "", (document.path.name,))
        return tuple(found for found in self._found.values() if found is not None)

    def _follow(self, document: Document, folder: str, trail: tuple[str, ...]) -> None:
        """Follow the entries of one document. `folder`: the document's folder below the mission's; `trail`:
        names of the including files."""
        entries = document.data.get("include")
        if entries is None:
            return
        if not isinstance(entries, list):
            message = "'include' is a list of files beside the mission and of the library"
            self._fault(document, (), message, "as '[common.yaml, library/recovery]'", code="P242")
            return
        for index, entry in enumerate(entries):
            name = self._name(document, entry, folder, index)
            if name is not None:
                self._include(document, index, name, trail)

    def _include(self, document: Document, index: int, name: str, trail: tuple[str, ...]) -> None:
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            message = f"the files include each other in a circle: {circle}"
            self._fault(document, (index,), message, code="P243")
            return
        if name in self._found:
            return
        if len(self._found) >= MAX_INCLUDED_FILES:
            if len(self._found) == MAX_INCLUDED_FILES:
                self._found[""] = None
                message = f"a mission includes at most {MAX_INCLUDED_FILES} files"
                self._fault(document, (index,), message, code="P243")
            return
        included = self._found[name] = self._read(document, index, name)
        if included is not None:
            self._follow(included, posixpath.dirname(name), (*trail, name))

    def _read(self, document: Document, index: int, name: str) -> Document | None:
        try:
            included = self._files.document(name)
        except FileError as error:
            for fault in error.faults:
                self._faults.add(fault)
            return None
        except PicktreeError as error:
            self._fault(document, (index,), str(error), code="P243")
            return None
        for fault in included.faults:
            self._faults.add(fault)
        self._characters += len(included.text)
        if self._characters > MAX_INCLUDED_CHARACTERS:
            message = f"the included files are larger than {MAX_INCLUDED_CHARACTERS // 1_000_000} MB together"
            self._fault(document, (index,), message, code="P243")
            return None
        if included.data.get("library") is not True:
            message = f"{name!r} is not meant for inclusion"
            hint = "a file to include needs 'library: true' at the top, and no tree 'Main'"
            self._fault(document, (index,), message, hint, code="P243")
            return None
        return included

    def _name(self, document: Document, entry: Value, folder: str, index: int) -> str | None:
        """Return an entry's name relative to the mission's folder; None when it may not be included."""
        if not isinstance(entry, str) or not entry:
            message = "an included file is named by a text"
            self._fault(document, (index,), message, "as 'common.yaml' or 'library/recovery'", code="P242")
            return None
        if entry.startswith(IN_LIBRARY) and not entry.endswith(_SUFFIXES):
            if "/" in entry.removeprefix(IN_LIBRARY):
                self._fault(document, (index,), f"the library has no {entry!r}", code="P243")
                return None
            return entry
        if posixpath.isabs(entry) or "\\" in entry or ":" in entry or "\x00" in entry:
            message = f"{entry!r} is not a path below the mission's folder"
            self._fault(document, (index,), message, "as 'common.yaml' or 'parts/bins.yaml'", code="P243")
            return None
        name = posixpath.normpath(posixpath.join(folder, entry))
        if name.startswith("../") or name == "..":
            message = f"{entry!r} lies outside of the mission's folder"
            self._fault(document, (index,), message, code="P243")
            return None
        if not name.endswith(_SUFFIXES):
            message = f"{entry!r} is not a YAML file"
            hint = f"'{entry}.yaml', or 'library/{entry}' for a file of the library"
            self._fault(document, (index,), message, hint, code="P242")
            return None
        return name

    def _fault(self, document: Document, loc: Location, message: str, hint: str = "", *, code: str) -> None:
        at: Location = ("include", *loc)
        self._faults.at(document, at, where(at), message, hint, code=code)


class TreeSetReader:
    """Reader of `trees:` of several documents. `lacking`: some included file could not be read."""

    def __init__(
        self,
        registry: NodeRegistry,
        faults: MissionDiagnostics,
        pointer: references.ExpressionLocator,
        *,
        lacking: bool,
    ) -> None:
        self._registry = registry
        self._faults = faults
        self._pointer = pointer
        self._lacking = lacking

    def read(self, documents: tuple[Document, ...]) -> dict[str, TreeSpec]:
        """Return the trees that could be read, by name. A name belongs to the first file that defines it."""
        bodies = [(document, self._bodies(document)) for document in documents]
        ports: dict[str, tuple[PortDeclaration, ...]] = {}
        homes: dict[str, Document] = {}
        docs: dict[str, str] = {}
        for document, found in bodies:
            declared = TreePorts(document, self._faults)
            for name, body in found.items():
                if self._named_well(document, name, homes):
                    homes[name] = document
                    ports[name] = declared.of(name, body)
                    docs[name] = declared.doc(name, body)
        ambiguous = frozenset(
            name for _, found in bodies for name in found if self._registry.find(name) is not None
        )
        trees: dict[str, TreeSpec] = {}
        for document, found in bodies:
            grammar = NodeSpecReader(
                document,
                self._registry,
                ports,
                self._faults,
                self._pointer,
                lacking=self._lacking,
                ambiguous=ambiguous,
            )
            for name, body in found.items():
                root = self._root(document, grammar, name, body) if homes.get(name) is document else None
                if root is not None:
                    mark = document.key_mark(("trees", name))
                    places = {p.key: document.mark(("trees", name, "ports", p.key)) for p in ports[name]}
                    trees[name] = TreeSpec(name, mark, ports[name], root, places, docs[name])
        trees = remap_keys(trees)
        for tree in trees.values():
            for fault in _unshared(tree, trees):
                self._faults.add(fault)
        return trees

    def _bodies(self, document: Document) -> Mapping[str, Value]:
        """Return the bodies under `trees:` of one file, by name."""
        value = document.data.get("trees")
        library = document.data.get("library") is True
        if value is None:
            hint = "'trees:' holds the sub-trees" if library else "'trees:' holds 'Main:' and the sub-trees"
            self._fault(document, (), "'trees:' is missing", hint, code="P205")
            return {}
        if not isinstance(value, dict):
            message = "'trees' is a mapping: a name, and the tree of that name"
            self._fault(document, ("trees",), message, code="P205")
            return {}
        if MAIN in value and library:
            message = f"a library has no tree {MAIN!r}: that is the mission's"
            self._fault(document, ("trees", MAIN), message, code="P248", key=True)
        if MAIN not in value and not library:
            message = f"the tree {MAIN!r} is missing; a mission begins there"
            self._fault(document, ("trees",), message, self._faults.nearest(MAIN, value), code="P206")
        return value

    def _named_well(self, document: Document, name: str, homes: Mapping[str, Document]) -> bool:
        loc: Location = ("trees", name)
        message, hint, code = "", "", "P209"
        if not IDENTIFIER.fullmatch(name):
            message, code = f"{show(name)} is not an ID", "P208"
            hint = "a letter or '_', then letters, digits and '_'"
        elif self._registry.find(name) is not None:
            message = f"{name!r} is a node already; a tree needs another name"
        elif name in homes:
            message, code = f"the tree {name!r} is given twice", "P247"
            hint = f"first on {homes[name].key_mark(loc).describe(str(document.path))}"
        if message:
            self._fault(document, loc, message, hint, code=code, key=True)
        return not message

    def _root(self, document: Document, grammar: NodeSpecReader, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key not in ("ports", "doc")}
            if not body:
                message = f"the tree {name!r} has no node"
                self._fault(document, loc, message, code="P210", key=True)
                return None
        return grammar.node(body, loc, name, ChildNames())

    def _fault(
        self,
        document: Document,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
    ) -> None:
        self._faults.at(document, loc, where(loc), message, hint, code=code, key=key)


@dataclass(frozen=True, slots=True)
class SceneNames:
    """Names that a mission may use, by kind of name; `scene` and `robot` are the sources."""

    scene: str
    robot: str
    names: Mapping[NameKind, tuple[str, ...]]


def load_surroundings(name: str, beside: Path | None = None, robot: str | None = None) -> SceneNames:
    """Load the names of a shipped scene, or of a scene file relative to `beside`, and of its robot.

    `robot`: shipped robot or robot file instead of the scene's; its path counts from the working directory.
    Raises FileError for a faulty file, PicktreeError for a missing one.
    """
    scene = load_scene(name, beside)
    own = Path(scene.source).parent
    return scene_names(scene, load_robot(robot or scene.robot, Path.cwd() if robot else own))


def scene_names(scene: SceneDescription, robot: RobotDescription) -> SceneNames:
    """Return the names that the scene and the robot define."""
    bins = tuple(str(body.id) for body in scene.bins)
    colours = dict.fromkeys(colour for entry in scene.loads for colour in entry.colours)
    bored = [fixture for fixture in scene.fixtures if fixture.holes]
    names: dict[NameKind, tuple[str, ...]] = {
        "camera": tuple(camera.name for camera in scene.cameras),
        "pose": tuple(robot.named),
        "bin": bins,
        "tote": tuple(heap_geometry.heap_regions(scene)),
        "hole": tuple(str(each.id) for fixture in bored for each in (fixture, *fixture.holes)),
        "fixture": (*(str(fixture.id) for fixture in scene.fixtures), *bins),
        "kind": tuple(entry.kind for entry in scene.catalogue),
        "colour": tuple(colours),
        "planner": tuple(planner_names.BUILT_IN),
    }
    return SceneNames(scene.name, robot.name, names)


_MISSION_KEYS = ("picktree", "kind", "name", "scene", "goal", "library", "include", "plugins", "trees")
_NOT_IN_LIBRARY = ("scene", "goal")
_GOAL_NAMES = ("total", "sorted", "misplaced", "left", "outstanding")


class MissionHead:
    """Reader of a document's top-level keys; it adds the plug-ins to the registry."""

    def __init__(
        self,
        document: Document,
        registry: NodeRegistry,
        faults: MissionDiagnostics,
        pointer: references.ExpressionLocator,
    ) -> None:
        self._document = document
        self._registry = registry
        self._faults = faults
        self._pointer = pointer

    @property
    def library(self) -> bool:
        """Whether the file only holds sub-trees for other missions."""
        return self._document.data.get("library") is True

    def check_keys(self) -> None:
        if self._document.data.get("library") not in (None, True, False):
            self._fault(("library",), "'library' is true or false", code="P202")
        for key in self._document.data:
            if key not in _MISSION_KEYS:
                hint = self._faults.nearest(key, _MISSION_KEYS)
                self._fault((key,), f"a mission has no key {show(key)}", hint, code="P201", key=True)
            elif key in _NOT_IN_LIBRARY and self.library:
                message = f"a library has no {key!r}: only a mission sets it"
                self._fault((key,), message, code="P248", key=True)

    def text(self, key: str) -> str | None:
        """Return the text under a key; None without one."""
        value = self._document.data.get(key)
        if value is None or (isinstance(value, str) and value):
            return value
        self._fault((key,), f"{key!r} is a text", code="P202")
        return None

    def goal(self) -> Expression | None:
        """Return the expression that the scorer evaluates after the run; None for a missing or faulty one."""
        value = self._document.data.get("goal")
        if value is None:
            return None
        if not isinstance(value, str):
            hint = "as 'misplaced == 0 and left <= 1'"
            self._fault(("goal",), "the goal is an expression", hint, code="P203")
            return None
        try:
            goal = Expression.parse(value)
        except expression_syntax.ExpressionError as error:
            self._goal_fault(value, error, "P225")
            return None
        unknown = sorted(goal.names - set(_GOAL_NAMES))
        for name in unknown:
            self._fault(
                ("goal",), f"a goal cannot use {name!r}", suggest_name(name, _GOAL_NAMES), code="P203"
            )
        try:
            check_types(goal, dict.fromkeys((*_GOAL_NAMES, *unknown), INT), {})
        except expression_syntax.ExpressionError as error:
            self._goal_fault(value, error, "P226")
        return goal

    def _goal_fault(self, goal: str, error: expression_syntax.ExpressionError, code: str) -> None:
        mark, message = self._pointer.describe(self._document.mark(("goal",)), goal, error)
        self._faults.add(Diagnostic(mark, "goal", message, "", code))

    def plugins(self) -> tuple[str, ...]:
        """Load and return the plug-ins that the file names."""
        value = self._document.data.get("plugins")
        if value is None:
            return ()
        if not isinstance(value, list):
            message = "'plugins' is a list of modules and of Python files beside the mission"
            self._fault(("plugins",), message, code="P202")
            return ()
        for index, plugin in enumerate(value):
            loc: Location = ("plugins", index)
            if not isinstance(plugin, str) or not plugin:
                message = "a plug-in is the name of a module or of a Python file"
                self._fault(loc, message, code="P202")
                continue
            try:
                self._registry.add_plugin(plugin, self._document.path.parent)
            except PluginError as error:
                self._fault(loc, error.message, error.hint, code=error.code, detail=error.detail)
        return tuple(plugin for plugin in value if isinstance(plugin, str))

    def _fault(
        self, loc: Location, message: str, hint: str = "", *, code: str, key: bool = False, detail: str = ""
    ) -> None:
        at = where(loc)
        self._faults.at(self._document, loc, at, message, hint, code=code, key=key, detail=detail)


@dataclass(frozen=True, slots=True)
class MissionReadResult:
    """Result of reading a mission file. With errors the mission holds only the parts that could be read."""

    mission: Mission
    faults: tuple[Diagnostic, ...]
    circuit: data_flow.ValueFlow | None
    """Connections between ports; None where sub-trees call each other in a circle."""
    pointer: references.ExpressionLocator


def load_mission(path: Path, registry: NodeRegistry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(read_document(path, "mission"), registry)


def parse_mission(
    text: str,
    path: Path,
    registry: NodeRegistry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = data_flow.FACT_TYPES,
) -> Mission:
    """Read a mission from a text. `path`: the place of the file, for files next to it.

    `files` supplies the included files, by default from the disk. `facts`: world facts that expressions may
    use. Raises FileError as `load_mission` does.
    """
    return read_mission(read_document(path, "mission", text), registry, files, facts)


def read_mission(
    document: Document,
    registry: NodeRegistry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = data_flow.FACT_TYPES,
) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its errors, and for a library."""
    reading = examine(document, registry, files, facts)
    return required_mission(reading.mission, reading.faults)


def required_mission(mission: Mission | None, faults: Iterable[Diagnostic]) -> Mission:
    """Return a mission that can be run. Raises FileError with the errors among its faults, and for a library.

    `mission`: None where it could not be read; `faults` has errors then.
    """
    errors = [fault for fault in faults if fault.severity == "error"]
    if not errors and mission is not None and mission.library:
        message = "this file is for inclusion: it has no tree 'Main' to begin with"
        errors.append(mission.document.fault(("library",), message, code="P206"))
    if errors or mission is None:
        raise FileError(errors)
    return mission


def examine(
    document: Document,
    registry: NodeRegistry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = data_flow.FACT_TYPES,
) -> MissionReadResult:
    """Read a mission as `read_mission` does, but return faulty missions and libraries, too."""
    beside = files or FilesOnDisk(document.path.parent)
    return _Reader(document, (registry or NodeRegistry()).copy(), beside, facts).read()


class _Reader:
    def __init__(
        self, document: Document, registry: NodeRegistry, files: MissionFiles, facts: Mapping[str, ValueType]
    ) -> None:
        self._document = document
        self._registry = registry
        self._files = files
        self._facts = facts
        self._faults = MissionDiagnostics()

    def read(self) -> MissionReadResult:
        document, faults = self._document, self._faults
        for fault in document.faults:
            faults.add(fault)
        before = len(faults)
        included = IncludeReader(self._files, faults).of(document)
        lacking = len(faults) > before
        documents = (document, *included)
        pointer = references.ExpressionLocator(documents)
        heads = [MissionHead(each, self._registry, faults, pointer) for each in documents]
        plugins: list[str] = []
        for head in heads:
            head.check_keys()
            plugins += head.plugins()
        trees = TreeSetReader(self._registry, faults, pointer, lacking=lacking).read(documents)
        circuit = self._circuit(trees, pointer)
        head = heads[0]
        mission = Mission(
            head.text("name") or document.path.stem,
            trees,
            document,
            head.text("scene"),
            head.goal(),
            tuple(dict.fromkeys(plugins)),
            included,
            head.library,
            sources=self._registry.plugins_of(_classes(trees)),
        )
        return MissionReadResult(mission, faults.all(), circuit, pointer)

    def _circuit(
        self, trees: Mapping[str, TreeSpec], pointer: references.ExpressionLocator
    ) -> data_flow.ValueFlow | None:
        """Check the connections between nodes; report errors that single nodes do not show."""
        calls = tuple(check_calls(trees))
        for fault in calls:
            self._faults.add(fault)
        if calls:
            return None
        # Nodes that could not be read may write further keys.
        unfinished = [name for name in trees if self._faults.within(name)]
        circuit = data_flow.ValueFlow(trees, self._facts)
        found = (*wiring_faults(circuit), *expression_faults(circuit, pointer, unfinished))
        for fault in found or unlike_comparisons(circuit, pointer):
            self._faults.add(fault)
        return circuit


def _classes(trees: Mapping[str, TreeSpec]) -> set[type[Node]]:
    """Return the classes of all nodes in the trees."""
    return {spec.node for tree in trees.values() for spec in tree.root.iterate() if spec.node is not None}

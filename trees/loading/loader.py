"""Loader of missions: mission file to Mission. All errors of the text are found and reported at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...files.expressions.expression import Expression, ExpressionError
from ...files.expressions.type_inference import INT, ValueType, check_types
from ...files.marks import Diagnostic, FileError, Location, where
from ...files.value_wording import suggest_name
from ...files.yaml.document import Document, read_document
from ...world.planner_names import BUILT_IN
from ...world.robot_model.description import RobotDescription
from ...world.robot_model.loading import load_robot
from ...world.scene.description import SceneDescription
from ...world.scene.heap_regions import heap_regions
from ...world.scene.scene_loading import load_scene
from ..circuit import ValueFlow
from ..fault_collector import MissionDiagnostics
from ..key_writers import FACT_TYPES
from ..mission import FilesOnDisk, Mission, MissionFiles, TreeSpec, check_calls
from ..node import Node
from ..port_types import show
from ..ports import NameKind
from ..references import ExpressionLocator
from ..unlike_values import unlike_comparisons
from ..wiring_faults import expression_faults, wiring_faults
from .plugin_import import PluginError
from .registry import NodeRegistry
from .tree_set import IncludeReader, TreeSetReader


@dataclass(frozen=True, slots=True)
class SceneNames:
    """Names that a mission may use, by kind of name; `scene` and `robot` are the sources."""

    scene: str
    robot: str
    names: Mapping[NameKind, tuple[str, ...]]


def load_surroundings(name: str, beside: Path | None = None, robot: str | None = None) -> SceneNames:
    """Load the names of a shipped scene, or of a scene file relative to `beside`, and of its robot.

    `robot`: shipped robot or robot file instead of the scene's; its path counts from the working directory.
    Raises FileError for a faulty file, PicktreeError when there is none.
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
        "tote": tuple(heap_regions(scene)),
        "hole": tuple(str(each.id) for fixture in bored for each in (fixture, *fixture.holes)),
        "fixture": (*(str(fixture.id) for fixture in scene.fixtures), *bins),
        "kind": tuple(entry.kind for entry in scene.catalogue),
        "colour": tuple(colours),
        "planner": tuple(BUILT_IN),
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
        pointer: ExpressionLocator,
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
                message = f"a library has no {key!r}: that is for the mission to say"
                self._fault((key,), message, code="P248", key=True)

    def text(self, key: str) -> str | None:
        """Return the text under a key; None when there is none."""
        value = self._document.data.get(key)
        if value is None or (isinstance(value, str) and value):
            return value
        self._fault((key,), f"{key!r} is a text", code="P202")
        return None

    def goal(self) -> Expression | None:
        """Return the expression that the scorer evaluates after the run; None when there is none or it is
        wrong."""
        value = self._document.data.get("goal")
        if value is None:
            return None
        if not isinstance(value, str):
            hint = "as 'misplaced == 0 and left <= 1'"
            self._fault(("goal",), "the goal is an expression", hint, code="P203")
            return None
        try:
            goal = Expression.parse(value)
        except ExpressionError as error:
            self._goal_fault(value, error, "P225")
            return None
        unknown = sorted(goal.names - set(_GOAL_NAMES))
        for name in unknown:
            self._fault(("goal",), f"a goal knows no {name!r}", suggest_name(name, _GOAL_NAMES), code="P203")
        try:
            check_types(goal, dict.fromkeys((*_GOAL_NAMES, *unknown), INT), {})
        except ExpressionError as error:
            self._goal_fault(value, error, "P226")
        return goal

    def _goal_fault(self, goal: str, error: ExpressionError, code: str) -> None:
        mark, message = self._pointer.told(self._document.mark(("goal",)), goal, error)
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
    circuit: ValueFlow | None
    """Connections between ports; None where sub-trees call each other in a circle."""
    pointer: ExpressionLocator


def load_mission(path: Path, registry: NodeRegistry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(read_document(path, "mission"), registry)


def parse_mission(
    text: str,
    path: Path,
    registry: NodeRegistry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
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
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its errors, and for a library."""
    reading = examine(document, registry, files, facts)
    faults = [fault for fault in reading.faults if fault.severity == "error"]
    if not faults and reading.mission.library:
        message = "this file is for inclusion: it has no tree 'Main' to begin with"
        faults.append(document.fault(("library",), message, code="P206"))
    if faults:
        raise FileError(faults)
    return reading.mission


def examine(
    document: Document,
    registry: NodeRegistry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
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
        pointer = ExpressionLocator(documents)
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

    def _circuit(self, trees: Mapping[str, TreeSpec], pointer: ExpressionLocator) -> ValueFlow | None:
        """Check the connections between nodes; report errors that single nodes do not show."""
        calls = tuple(check_calls(trees))
        for fault in calls:
            self._faults.add(fault)
        if calls:
            return None
        # Nodes that could not be read may write further keys.
        unfinished = [name for name in trees if self._faults.within(name)]
        circuit = ValueFlow(trees, self._facts)
        found = (*wiring_faults(circuit), *expression_faults(circuit, pointer, unfinished))
        for fault in found or unlike_comparisons(circuit, pointer):
            self._faults.add(fault)
        return circuit


def _classes(trees: Mapping[str, TreeSpec]) -> set[type[Node]]:
    """Return the classes of all nodes in the trees."""
    return {spec.node for tree in trees.values() for spec in tree.root.iterate() if spec.node is not None}

"""Reader of the trees of all files of a mission, with one common set of names."""

from __future__ import annotations

from collections.abc import Mapping

from ...files.yaml.document import Document, Location, Value, where
from ..declaration import IDENTIFIER
from ..mission import MAIN, NodeSpec, TreeSpec
from ..ports import PortDeclaration
from ..values.fault_collector import MissionDiagnostics
from ..values.port_types import show
from ..values.references import ExpressionLocator
from .children import ChildNames
from .grammar import NodeSpecReader
from .registry import NodeRegistry
from .tree_ports import TreePorts


class TreeSetReader:
    """Reader of `trees:` of several documents. `lacking`: some included file could not be read."""

    def __init__(
        self, registry: NodeRegistry, faults: MissionDiagnostics, pointer: ExpressionLocator, *, lacking: bool
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
        for document, found in bodies:
            declared = TreePorts(document, self._faults)
            for name, body in found.items():
                if self._named_well(document, name, homes):
                    homes[name] = document
                    ports[name] = declared.of(name, body)
        trees: dict[str, TreeSpec] = {}
        for document, found in bodies:
            grammar = NodeSpecReader(
                document, self._registry, ports, self._faults, self._pointer, lacking=self._lacking
            )
            for name, body in found.items():
                root = self._root(document, grammar, name, body) if homes.get(name) is document else None
                if root is not None:
                    mark = document.key_mark(("trees", name))
                    places = {p.key: document.mark(("trees", name, "ports", p.key)) for p in ports[name]}
                    trees[name] = TreeSpec(name, mark, ports[name], root, places)
        return trees

    def _bodies(self, document: Document) -> Mapping[str, Value]:
        """Return the bodies under `trees:` of one file, by name."""
        value = document.data.get("trees")
        library = document.data.get("library") is True
        if value is None:
            hint = "it holds the sub-trees" if library else "it holds 'Main:' and the sub-trees"
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
            hint = f"first on {homes[name].key_mark(loc).told(str(document.path))}"
        if message:
            self._fault(document, loc, message, hint, code=code, key=True)
        return not message

    def _root(self, document: Document, grammar: NodeSpecReader, name: str, body: Value) -> NodeSpec | None:
        loc: Location = ("trees", name)
        if isinstance(body, dict):
            body = {key: value for key, value in body.items() if key != "ports"}
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

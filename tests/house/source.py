"""Source of the product: modules, their imports, circles and closures of imports."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property
from pathlib import Path


class When(StrEnum):
    """Time at which an import is carried out."""

    LOADING = "when it is loaded"
    CALLING = "in a function"
    TYPING = "for types only"


ALWAYS = tuple(When)
Graph = Mapping[str, Collection[str]]
"""Imported modules, or folders, by the importing one."""


@dataclass(frozen=True, eq=False)
class Module:
    """A file of a product package. That of a package itself, its `__init__.py`, is named as the package."""

    name: str
    file: str
    """Path from the root of the checkout, with slashes."""
    lines: int
    tree: ast.Module

    @property
    def is_package(self) -> bool:
        return self.file.rpartition("/")[2] == "__init__.py"

    @property
    def package(self) -> str:
        return self.name if self.is_package else self.name.rpartition(".")[0]

    @property
    def stem(self) -> str:
        return self.name.rpartition(".")[2]


@dataclass(frozen=True)
class Import:
    importer: str
    imported: str
    line: int
    when: When


@dataclass(frozen=True, eq=False)
class House:
    """The product packages that a pyproject.toml lists, with all their files."""

    packages: tuple[str, ...]
    files: Mapping[str, Module]
    """Modules and packages by name."""

    @cached_property
    def modules(self) -> list[Module]:
        """Files other than `__init__.py`."""
        return [file for file in self.files.values() if not file.is_package]

    @cached_property
    def imports(self) -> list[Import]:
        """Imports of product files by product files, those of a re-exported name also from its origin.

        The packages that enclose an imported module are left out.
        """
        exports = {file.name: self._exports(file) for file in self.files.values() if file.is_package}
        found = dict[Import, None]()
        for file in self.files.values():
            for statement, when in import_statements(file.tree.body):
                for base, name in _names(file, statement):
                    origins = self._targets(base, name)
                    if origins == (base,) and base in exports:
                        origins += exports[base].get(name, ())
                    found |= {
                        Import(file.name, origin, statement.lineno, when): None
                        for origin in origins
                        if origin != file.name
                    }
        return list(found)

    def graph(self, whens: Collection[When] = ALWAYS) -> dict[str, set[str]]:
        graph = {name: set[str]() for name in self.files}
        for one in self.imports:
            if one.when in whens:
                graph[one.importer].add(one.imported)
        return graph

    def folder_graph(self, whens: Collection[When] = ALWAYS) -> dict[str, set[str]]:
        """Return the imports between folders. A sub-folder is a node of its own."""
        graph = {node: set[str]() for node in self.folder_nodes.values()}
        for importer, imported in self.graph(whens).items():
            node = self.folder_nodes[importer]
            graph[node] |= {self.folder_nodes[name] for name in imported} - {node}
        return graph

    @cached_property
    def folder_nodes(self) -> dict[str, str]:
        """Node of each file in `folder_graph`: its folder.

        Each file of the top folder is a node: the interface of the whole lies there beside what all use.
        """
        top = self.packages[0]
        return {name: name if file.package == top else file.package for name, file in self.files.items()}

    def _exports(self, package: Module) -> dict[str, tuple[str, ...]]:
        """Return the origins of the names that an `__init__.py` imports."""
        return {
            alias.asname or alias.name: self._targets(_base(package, statement), alias.name)
            for statement, _ in import_statements(package.tree.body)
            if isinstance(statement, ast.ImportFrom)
            for alias in statement.names
        }

    def _targets(self, base: str, name: str) -> tuple[str, ...]:
        whole = f"{base}.{name}" if name else base
        return next(((found,) for found in (whole, base) if found in self.files), ())


@cache
def own_house() -> House:
    """The product's own source, parsed once in a process: it takes 2 to 4 s of CPU."""
    return read_house(Path(__file__).parents[2])


def read_house(root: Path) -> House:
    """Parse the files of the packages that `pyproject.toml` lists."""
    setuptools = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    packages: list[str] = setuptools["packages"]
    files = dict[str, Module]()
    for package in packages:
        for path in sorted(_folder(root, package, setuptools.get("package-dir", {})).glob("*.py")):
            name = package if path.stem == "__init__" else f"{package}.{path.stem}"
            text = path.read_text(encoding="utf-8")
            file = path.relative_to(root).as_posix()
            files[name] = Module(name, file, len(text.splitlines()), ast.parse(text, file))
    return House(tuple(packages), files)


def _folder(root: Path, package: str, places: Mapping[str, str]) -> Path:
    above, below = package, list[str]()
    while above and above not in places:
        above, _, last = above.rpartition(".")
        below.insert(0, last)
    return root.joinpath(places.get(above, "."), *below)


_SUITES = ("body", "handlers", "orelse", "finalbody", "cases")
"""Fields of statements, handlers and cases that hold statements, in the order of the text."""


def nested(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements, handlers and cases directly below a node. Expressions are left out unread."""
    for field in _SUITES:
        yield from getattr(node, field, ())


def import_statements(
    suite: Iterable[ast.AST], when: When = When.LOADING
) -> Iterator[tuple[ast.Import | ast.ImportFrom, When]]:
    """Yield the imports in some statements with their time, those in nested statements, too."""
    for node in suite:
        match node:
            case ast.Import() | ast.ImportFrom():
                yield node, when
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                yield from import_statements(node.body, When.CALLING if when is When.LOADING else when)
            case ast.If(test=ast.Name(id="TYPE_CHECKING") | ast.Attribute(attr="TYPE_CHECKING")):
                yield from import_statements(node.body, When.TYPING)
                yield from import_statements(node.orelse, when)
            case ast.stmt() | ast.ExceptHandler() | ast.match_case():
                yield from import_statements(nested(node), when)
            case _:
                pass


def statements(suite: Iterable[ast.AST]) -> Iterator[ast.stmt]:
    """Yield statements and those nested in them."""
    for node in suite:
        if isinstance(node, ast.stmt):
            yield node
        if isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):
            yield from statements(nested(node))


def _names(file: Module, statement: ast.Import | ast.ImportFrom) -> list[tuple[str, str]]:
    """Return the imported names, each with the module or package it is imported from."""
    if isinstance(statement, ast.Import):
        return [(alias.name, "") for alias in statement.names]
    return [(_base(file, statement), alias.name) for alias in statement.names]


def _base(file: Module, statement: ast.ImportFrom) -> str:
    if not statement.level:
        return statement.module or ""
    enclosing = file.package.split(".")
    above = enclosing[: len(enclosing) - statement.level + 1]
    return ".".join([*above, *([statement.module] if statement.module else [])])


def closure(graph: Graph, start: str, barred: Collection[str] = ()) -> set[str]:
    """Return all that is reached from a node, itself included. `barred`: nodes that are not passed."""
    reached, ahead = {start}, [start]
    while ahead:
        new = set(graph[ahead.pop()]).difference(reached, barred)
        reached |= new
        ahead += new
    return reached


def circles(graph: Graph) -> list[list[str]]:
    """Return the strongly connected components of more than one node, the largest first (Kosaraju 1978)."""
    backwards = {name: set[str]() for name in graph}
    for name, targets in graph.items():
        for target in targets:
            backwards[target].add(name)
    done = set[str]()
    found = list[list[str]]()
    for root in reversed(_finished(graph)):
        if root not in done:
            component = closure(backwards, root, done)
            done |= component
            if len(component) > 1:
                found.append(sorted(component))
    return sorted(found, key=lambda component: (-len(component), component))


def _finished(graph: Graph) -> list[str]:
    """Return the nodes in the order in which a search in depth leaves them."""
    seen, order = set[str](), list[str]()
    for root in graph:
        stack = [] if root in seen else [(root, iter(sorted(graph[root])))]
        seen.add(root)
        while stack:
            node, ahead = stack[-1]
            following = next((name for name in ahead if name not in seen), None)
            if following is None:
                order.append(node)
                stack.pop()
            else:
                seen.add(following)
                stack.append((following, iter(sorted(graph[following]))))
    return order

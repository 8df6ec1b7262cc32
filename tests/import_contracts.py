"""Check the import contracts of pyproject.toml on the graph of imports behind the doors.

    python tests/import_contracts.py

A door is a package whose `__init__.pyi` names what its modules offer to others; lazy_loader imports it on
request. grimp reads no stubs. It sees `from picktree.robot.planning import LineGoal` end at the door, so that
every contract would be kept whatever the name leads to. Here such an import leads to the stub's module.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import grimp
from importlinter import configuration
from importlinter.adapters.building import GraphBuilder
from importlinter.application.app_config import settings
from importlinter.application.use_cases import lint_imports

ROOT = Path(__file__).resolve().parents[1]
Doors = Mapping[str, Mapping[str, str]]
"""Modules by the name that a door has for others, by door."""


def file_of(module: str) -> Path:
    """Return the file of a module or package of the checkout."""
    path = ROOT.joinpath(*module.split(".")[1:])
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def read_doors(root: Path = ROOT) -> dict[str, dict[str, str]]:
    """Return what the stubs of all packages below the top one say."""
    doors: dict[str, dict[str, str]] = {}
    rooms = sorted(file.parent for file in root.glob("*/__init__.py"))
    for stub in sorted(stub for room in rooms for stub in room.rglob("__init__.pyi")):
        door = ".".join(("picktree", *stub.relative_to(root).parent.parts))
        names = doors.setdefault(door, {})
        for node in ast.parse(stub.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    names[alias.name] = f"{door}.{node.module or alias.name}"
    return doors


def imports_from_doors(source: str, doors: Doors) -> Iterator[tuple[str, str, int]]:
    """Yield door, name and line of each name that a module imports from a door, in functions, too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and not node.level and node.module in doors:
            for alias in node.names:
                yield node.module, alias.name, node.lineno


def look_through_doors(graph: grimp.ImportGraph, doors: Doors, sources: Mapping[str, str]) -> None:
    """Let each import from a door lead to the module that has the name. `sources`: texts by module.

    Raises KeyError for a name that its door does not have.
    """
    for module, source in sources.items():
        for door, name, line in imports_from_doors(source, doors):
            graph.add_import(
                importer=module,
                imported=doors[door][name],
                line_number=line,
                line_contents=f"from {door} import {name}",
            )
            graph.remove_import(importer=module, imported=door)


def ways_around_doors(doors: Doors, sources: Mapping[str, str]) -> list[str]:
    """Return imports that are neither from a door nor, relative, of a module of the same package."""
    found = list[str]()
    for module, source in sources.items():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Import):
                ours = [alias.name for alias in node.names if alias.name.startswith("picktree.")]
            elif not isinstance(node, ast.ImportFrom):
                continue
            elif node.level == 0:
                ours = [node.module or ""] if (node.module or "").startswith("picktree.") else []
            else:
                name = node.module or ""
                beside = (
                    node.level == 1 and "." not in name and f"{module.rpartition('.')[0]}.{name}" not in doors
                )
                ours = [] if beside else ["." * node.level + name]
            found += [f"{module}, line {node.lineno}: {name}" for name in ours if name not in doors]
    return found


def sources_of(graph: grimp.ImportGraph) -> dict[str, str]:
    ours = sorted(module for module in graph.modules if module.split(".")[0] == "picktree")
    return {module: file_of(module).read_text(encoding="utf-8") for module in ours}


class GraphThroughDoors(GraphBuilder):
    """The graph that import-linter checks."""

    def build(
        self,
        root_package_names: list[str],
        cache_dir: str | None,
        include_external_packages: bool = False,
        exclude_type_checking_imports: bool = False,
    ) -> grimp.ImportGraph:
        graph = super().build(
            root_package_names, cache_dir, include_external_packages, exclude_type_checking_imports
        )
        look_through_doors(graph, read_doors(), sources_of(graph))
        return graph


def main() -> int:
    configuration.configure()
    settings.configure(GRAPH_BUILDER=GraphThroughDoors())
    kept = lint_imports(cache_dir=None, no_logo=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())

"""Figures of the product's source.

A module is a file of a product package other than `__init__.py`. Imports in functions and for types only are
imports, unless a figure says otherwise. The importer of a name that a package re-exports also imports the
module that defines the name.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from pathlib import Path
from statistics import median

from .docstrings import MAX_WORDS, docstrings
from .names import (
    Definition,
    classes,
    constants,
    in_several_modules,
    public_functions,
    with_equal_value,
)
from .source import ALWAYS, Graph, House, Module, When, circles, closure, statements

ROOT = Path(__file__).parents[2]
LONG, VERY_LONG = 300, 400
"""Lines of a module above which it counts as long."""
FULL = 15
"""Modules directly in a folder above which it counts as full."""
MOST_FREQUENT = 10
"""Constants that are listed by name."""
SKILLS = ("Grasp", "GoTo")
COMMANDS = ("check", "explain")

Value = float | None
"""None: the source has nothing of the kind."""
Figures = dict[str, dict[str, Value]]
"""By group and name."""


def figures(house: House) -> Figures:
    """Compute the figures that follow from the source alone."""
    return {
        "modules": _sizes(house),
        "modules by room": dict(Counter(_room(module) for module in house.modules)),
        "lines by room": _lines_by_room(house),
        "modules with one importer": _single_figures(house),
        "names in several modules": _names(house),
        "constants": _constants(house),
        f"constants in several modules, the {MOST_FREQUENT} most frequent": _frequent_constants(house),
        "circles of imports between files": _circle_figures(house.graph),
        "circles of imports between folders": _circle_figures(house.folder_graph),
        "folders": _folder_figures(house),
        "docstrings": docstring_figures(house),
        "imported at the top of modules from": _closures(house),
    }


def _sizes(house: House) -> dict[str, Value]:
    lines = [module.lines for module in house.modules]
    functions = function_lengths(house)
    return {
        "modules": len(lines),
        "lines": sum(lines),
        f"above {LONG} lines": len(long_modules(house)),
        f"above {VERY_LONG} lines": len(long_modules(house, VERY_LONG)),
        "lines of a module, median": median(lines),
        "functions": len(functions),
        "lines of a function, median": median(functions) if functions else None,
        "lines of a function, 90 % have no more": sorted(functions)[ceil(0.9 * len(functions)) - 1]
        if functions
        else None,
    }


def long_modules(house: House, lines: int = LONG) -> list[Module]:
    return sorted((module for module in house.modules if module.lines > lines), key=lambda long: -long.lines)


def function_lengths(house: House) -> list[int]:
    """Return the lines of each function and method, docstring included, decorators left out."""
    return [
        (node.end_lineno or node.lineno) - node.lineno + 1
        for module in house.modules
        for node in statements(module.tree.body)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def _room(module: Module) -> str:
    return (module.name.split(".")[1] + "/") if module.name.count(".") > 1 else "(top)"


def _lines_by_room(house: House) -> dict[str, Value]:
    lines = Counter[str]()
    for module in house.modules:
        lines[_room(module)] += module.lines
    return dict(lines)


def importers(house: House) -> dict[str, set[str]]:
    """Return the modules that import each module."""
    found = {module.name: set[str]() for module in house.modules}
    for one in house.imports:
        if one.imported in found and one.importer in found:
            found[one.imported].add(one.importer)
    return found


def single_importers(house: House) -> dict[str, str]:
    """Return the importer of each module that has one only."""
    return {name: next(iter(by)) for name, by in importers(house).items() if len(by) == 1}


def in_same_folder(house: House, name: str, importer: str) -> bool:
    return house.files[name].package == house.files[importer].package


def _single_figures(house: House) -> dict[str, Value]:
    single = single_importers(house)
    return {
        "modules": len(single),
        "importer in the same folder": sum(in_same_folder(house, *pair) for pair in single.items()),
    }


def _names(house: House) -> dict[str, Value]:
    repeated_classes = in_several_modules(classes(house))
    repeated_functions = in_several_modules(public_functions(house))
    return {
        "names of classes": len(repeated_classes),
        "definitions of these classes": _definitions(repeated_classes),
        "names of public functions": len(repeated_functions),
        "definitions of these functions": _definitions(repeated_functions),
    }


def _definitions(repeated: Mapping[str, Sequence[Definition]]) -> int:
    return sum(len(found) for found in repeated.values())


def _constants(house: House) -> dict[str, Value]:
    found = constants(house)
    repeated, equal = in_several_modules(found), with_equal_value(found)
    return {
        "constants": len(found),
        "with a leading underscore": sum(constant.name.startswith("_") for constant in found),
        "names in several modules": len(repeated),
        "definitions of these names": _definitions(repeated),
        "names with one literal value in several modules": len(equal),
        "definitions of these values": _definitions(equal),
    }


def _frequent_constants(house: House) -> dict[str, Value]:
    repeated = in_several_modules(constants(house))
    return {name: len(found) for name, found in list(repeated.items())[:MOST_FREQUENT]}


TIMES: Mapping[str, Sequence[When]] = {"when loaded": (When.LOADING,), "all imports": ALWAYS}


def _circle_figures(graph: Callable[[Sequence[When]], Graph]) -> dict[str, Value]:
    found = dict[str, Value]()
    for name, whens in TIMES.items():
        components = circles(graph(whens))
        found[f"{name}: circles"] = len(components)
        found[f"{name}: in the largest"] = len(components[0]) if components else 0
        found[f"{name}: in any"] = sum(map(len, components))
    return found


def folder_sizes(house: House) -> dict[str, int]:
    """Return the number of modules directly in each folder."""
    counted = Counter(module.package for module in house.modules)
    return {package: counted[package] for package in house.packages}


def lone_folders(house: House) -> list[str]:
    """Return the folders that have a single module, sub-folders included."""
    sizes = folder_sizes(house)
    whole = {
        package: sum(size for name, size in sizes.items() if f"{name}.".startswith(f"{package}."))
        for package in sizes
    }
    return [package for package, size in whole.items() if size == 1]


def _folder_figures(house: House) -> dict[str, Value]:
    sizes = folder_sizes(house)
    return {
        "rooms": len({_room(module) for module in house.modules if module.package != house.packages[0]}),
        "folders": len(sizes),
        "modules in the fullest": max(sizes.values()),
        f"with more than {FULL} modules": sum(size > FULL for size in sizes.values()),
        "of a single module": len(lone_folders(house)),
    }


def starts(house: House) -> dict[str, str | None]:
    """Return the modules of the measured skills and commands; None: there is not exactly one."""
    found = {f"skill {skill}": _defining(house, skill) for skill in SKILLS}
    for command in COMMANDS:
        found[f"command {command}"] = [
            module.name
            for module in house.modules
            if "cli" in module.package.split(".") and _defines_function(module, command)
        ]
    return {start: modules[0] if len(modules) == 1 else None for start, modules in found.items()}


def _defining(house: House, name: str) -> list[str]:
    return [
        module.name
        for module in house.modules
        if any(isinstance(node, ast.ClassDef) and node.name == name for node in module.tree.body)
    ]


def _defines_function(module: Module, name: str) -> bool:
    return any(isinstance(node, ast.FunctionDef) and node.name == name for node in module.tree.body)


def _closures(house: House) -> dict[str, Value]:
    graph = house.graph((When.LOADING,))
    found = dict[str, Value]()
    for name, start in starts(house).items():
        found |= _extent(house, name, closure(graph, start) if start else None)
    return found


def _extent(house: House, name: str, reached: set[str] | None) -> dict[str, Value]:
    """Count modules and their lines; None: nothing to count."""
    lines = [module.lines for module in house.modules if reached and module.name in reached]
    return {f"{name}: modules": len(lines) or None, f"{name}: lines": sum(lines) or None}


_LOADED = """
import contextlib, io, json, runpy, sys
package, *words = sys.argv[1:]
sys.argv = [package, *words]
try:
    with contextlib.redirect_stdout(io.StringIO()):
        runpy.run_module(package, run_name="__main__", alter_sys=True)
except SystemExit as end:
    if end.code:
        raise
print(json.dumps([name for name in sys.modules if name.partition(".")[0] == package]))
"""


def loaded(package: str, words: Sequence[str]) -> set[str]:
    """Return the product's modules and packages that a command loads, `__main__` left out.

    Runs it in a process of its own. Raises CalledProcessError when its exit code is not 0.
    """
    ran = subprocess.run(
        [sys.executable, "-P", "-c", _LOADED, package, *words], stdout=subprocess.PIPE, text=True, check=True
    )
    return set(json.loads(ran.stdout.splitlines()[-1]))


def loaded_figures(house: House, root: Path = ROOT) -> Figures:
    """Count what two commands load on files of the repository."""
    arguments = {"check": root / "examples" / "sort_by_colour.yaml", "explain": _small_log(root)}
    counts = dict[str, Value]()
    for command, argument in arguments.items():
        reached = loaded(house.packages[0], [command, str(argument)])
        counts |= _extent(house, f"command {command}", reached)
    return {"loaded by a run of": counts}


def _small_log(root: Path) -> Path:
    return next((root / "tests").glob("**/golden/small.mcap"))


def docstring_figures(house: House) -> dict[str, Value]:
    """Count docstrings, and those that are hard to read."""
    found = [docstring for file in house.files.values() for docstring in docstrings(file.tree)]
    return {
        "docstrings": len(found),
        "obscure first word": sum(docstring.has_obscure_first_word for docstring in found),
        f"first sentence of more than {MAX_WORDS} words": sum(d.has_long_first_sentence for d in found),
        f"any sentence of more than {MAX_WORDS} words": sum(d.has_long_sentence for d in found),
    }

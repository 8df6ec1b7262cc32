"""Lists of what the figures count, by file and line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .docstrings import MAX_WORDS, Docstring, docstrings
from .figures import (
    TIMES,
    folder_sizes,
    in_same_folder,
    lone_folders,
    long_modules,
    single_importers,
    starts,
)
from .names import (
    Definition,
    classes,
    constants,
    in_several_modules,
    public_functions,
    with_equal_value,
)
from .source import Graph, House, Import, When, circles, closure


@dataclass(frozen=True)
class Entry:
    file: str
    """Path from the root of the checkout; that of a folder ends with a slash."""
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.text}"


def long(house: House) -> list[Entry]:
    """Return the long modules, the longest first."""
    return [Entry(module.file, 1, f"{module.lines} lines") for module in long_modules(house)]


def single(house: House) -> list[Entry]:
    """Return the modules with one importer, at their first line."""
    return [
        Entry(
            house.files[name].file,
            1,
            f"imported by {house.files[importer].file} alone"
            + (", same folder" if in_same_folder(house, name, importer) else ""),
        )
        for name, importer in single_importers(house).items()
    ]


def repeated_classes(house: House) -> list[Entry]:
    return _definitions(in_several_modules(classes(house)))


def repeated_functions(house: House) -> list[Entry]:
    return _definitions(in_several_modules(public_functions(house)))


def repeated_constants(house: House) -> list[Entry]:
    return _definitions(in_several_modules(constants(house)))


def equal_constants(house: House) -> list[Entry]:
    return _definitions(with_equal_value(constants(house)))


def _definitions(repeated: Mapping[str, Sequence[Definition]]) -> list[Entry]:
    return [
        Entry(definition.file, definition.line, f"{name} (one of {len(found)})")
        for name, found in repeated.items()
        for definition in found
    ]


def file_circles(house: House) -> list[Entry]:
    """Return the imports within each circle of files."""
    return _circles(house, "files", house.graph, {name: name for name in house.files})


def folder_circles(house: House) -> list[Entry]:
    """Return the imports within each circle of folders."""
    return _circles(house, "folders", house.folder_graph, house.folder_nodes)


def _circles(
    house: House, kind: str, graph: Callable[[Sequence[When]], Graph], nodes: Mapping[str, str]
) -> list[Entry]:
    """Return the imports between different nodes of each circle; `nodes` has the node of each file."""
    return [
        Entry(
            house.files[one.importer].file,
            one.line,
            f"{time}, circle {number} ({len(component)} {kind}): imports {house.files[one.imported].file}"
            f" {one.when}",
        )
        for time, whens in TIMES.items()
        for number, component in enumerate(circles(graph(whens)), 1)
        for one in house.imports
        if one.when in whens and _inside(one, nodes, component)
    ]


def _inside(one: Import, nodes: Mapping[str, str], component: Sequence[str]) -> bool:
    ends = nodes[one.importer], nodes[one.imported]
    return ends[0] != ends[1] and all(end in component for end in ends)


def folders(house: House) -> list[Entry]:
    """Return the folders with the number of modules directly in them, the fullest first."""
    lone = lone_folders(house)
    return [
        Entry(_path(package), 1, f"{size} directly in it" + (", no other below" if package in lone else ""))
        for package, size in sorted(folder_sizes(house).items(), key=lambda entry: -entry[1])
    ]


def _path(package: str) -> str:
    """Return a folder's path from the product's root."""
    return "/".join([*package.split(".")[1:], ""]) or "./"


def closures(house: House) -> list[Entry]:
    """Return the modules that are loaded with each measured skill and command."""
    graph = house.graph((When.LOADING,))
    return [
        Entry(module.file, 1, f"{name}: {module.lines} lines")
        for name, start in starts(house).items()
        if start
        for module in house.modules
        if module.name in closure(graph, start)
    ]


def faulty_docstrings(house: House) -> list[Entry]:
    """Return the docstrings with an obscure first word or a long sentence: fault and first line."""
    return [
        Entry(file.file, docstring.line, f"{', '.join(faults)}: {docstring.first_line}")
        for file in house.files.values()
        for docstring in docstrings(file.tree)
        if (faults := _faults(docstring))
    ]


def _faults(docstring: Docstring) -> list[str]:
    faults = ["first word"] if docstring.has_obscure_first_word else []
    if docstring.has_long_first_sentence:
        faults.append(f"first sentence of {docstring.lengths[0]} words")
    if any(length > MAX_WORDS for length in docstring.lengths[1:]):
        faults.append(f"sentence of {max(docstring.lengths[1:])} words")
    return faults


LISTS: Mapping[str, Callable[[House], list[Entry]]] = {
    "long": long,
    "single": single,
    "classes": repeated_classes,
    "functions": repeated_functions,
    "constants": repeated_constants,
    "equal": equal_constants,
    "circles": file_circles,
    "folder-circles": folder_circles,
    "folders": folders,
    "closures": closures,
    "docstrings": faulty_docstrings,
}

"""Keys read before they are written or never; unused sub-trees, ports, files and breakpoints."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator

from picktree.files import Diagnostic, suggest_name
from picktree.files.yaml import Document
from picktree.trees import IN_LIBRARY, MAIN, PortDeclaration, TreeSpec, called_by, data_flow, references

from .flow_walk import KeyRead
from .keys import KeyUsage
from .mission_survey import LintModel


def read_before_written(survey: LintModel) -> Iterator[Diagnostic]:
    """P301, P302: a key that no node, or not every path, has written."""
    for read in survey.walk.reads.values():
        if not read.missing or not survey.own(read.spec.mark):
            continue
        usage = survey.usage[read.tree]
        what = f"port {read.place!r}" if read.place in read.spec.ports else read.place
        writers = [touch for touch in usage.writes.get(read.key, ()) if touch.spec is not read.spec]
        if read.ever:
            message = f"{what}: perhaps nothing has written {read.key!r} yet"
            hint = _writer(read, writers) if writers else ""
            yield survey.fault(read.spec, message, hint, code="P302", at=read.place)
        else:
            message = f"{what}: nothing has written {read.key!r} when it is read"
            hint = _remedy(survey, read, usage, writers)
            yield survey.fault(read.spec, message, hint, code="P301", at=read.place, error=True)


def _writer(read: KeyRead, writers: Iterable[data_flow.KeyUse]) -> str:
    spec = next(iter(writers)).spec
    where = f"{spec.name}, line {spec.mark.line}, writes it"
    before = spec.mark < read.spec.places.get(read.place, read.spec.mark)
    return f"{where}, but may fail or be skipped" if before else f"{where}, further down"


def _remedy(survey: LintModel, read: KeyRead, usage: KeyUsage, writers: list[data_flow.KeyUse]) -> str:
    if writers:
        return _writer(read, writers)
    changed = (one for one in read.spec.postconditions.get(read.place, ()) if not one.new)
    if any(one.key == read.key for one in changed):
        return f"'{read.key} := …' writes a key for the first time, '=' and '+=' only change one"
    inputs = (port.key for port in survey.mission.trees[read.tree].ports)
    known = [key for key in dict.fromkeys((*inputs, *usage.writes)) if key != read.key]
    return suggest_name(read.key, known) if known else f"nothing in {read.tree} writes any key"


def never_read(survey: LintModel) -> Iterator[Diagnostic]:
    """P303: an output, or an assignment, that no node reads."""
    for tree in survey.trees():
        usage = survey.usage[tree.name]
        outputs = {port.key for port in tree.ports if port.direction == "out"}
        for key, touches in usage.writes.items():
            if key in usage.reads or key in outputs or key.startswith(references.ROOT_KEY):
                continue
            first = touches[0]
            if isinstance(first.what, PortDeclaration) and first.what.remapped:
                continue
            message = f"{first.at}: {key!r} is written, and nothing in {tree.name} reads it"
            inputs = {port.key for port in tree.ports if port.direction == "in"}
            given = {*inputs, *usage.writes, *data_flow.FACT_TYPES}
            hint = suggest_name(key, (read for read in usage.reads if read not in given))
            hint = hint if hint.startswith("did you mean") else "leave out an output that no node needs"
            yield survey.fault(first.spec, message, hint, code="P303", at=first.at)


def unused_trees(survey: LintModel) -> Iterator[Diagnostic]:
    """P340: a sub-tree that the mission does not use."""
    for tree in survey.trees():
        if tree.name in survey.used:
            continue
        users = [other.name for other in survey.trees() if tree.name in called_by(other)]
        message = f"nothing uses the sub-tree {tree.name!r}"
        message += f" but {', '.join(users)}, which nothing uses" if users else ""
        hint = "'library: true' makes a file of sub-trees for others" if len(survey.mission.trees) > 1 else ""
        yield Diagnostic(tree.mark, f"trees.{tree.name}", message, hint, "P340", "warning")


def unused_ports(survey: LintModel) -> Iterator[Diagnostic]:
    """P341, P342: an input that no node of the tree reads, an output that no node writes."""
    for tree in survey.trees():
        usage = survey.usage[tree.name]
        what = "the mission" if tree.name == MAIN else f"the tree {tree.name!r}"
        for port in tree.ports:
            if port.direction == "in" and port.key not in usage.reads:
                message = f"nothing in {what} reads its input {port.key!r}"
                yield _port_fault(tree, port.key, message, "P341")
            elif port.direction == "out" and port.key not in usage.writes:
                message = f"nothing in {what} writes its output {port.key!r}"
                yield _port_fault(tree, port.key, message, "P342")


def _port_fault(tree: TreeSpec, key: str, message: str, code: str) -> Diagnostic:
    mark = tree.places.get(key, tree.mark)
    return Diagnostic(mark, f"trees.{tree.name}.ports.{key}", message, "", code, "warning")


def unused_files(survey: LintModel) -> Iterator[Diagnostic]:
    """P343: an included file without a used tree."""
    document, names = survey.mission.document, survey.mission.files
    entries = document.data.get("include")
    documents = dict(zip(names, survey.mission.included, strict=True))
    homes = {tree.name: tree.mark.file for tree in survey.mission.trees.values()}
    called = {name for tree in survey.trees() for name in called_by(tree) if name in homes}
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        name = _normal(str(entry), "")
        files = {str(found.path) for found in _with_included(name, documents)}
        if files and not any(homes[tree] in files for tree in called):
            yield document.fault(
                ("include", index),
                f"nothing uses a tree of {str(entry)!r}",
                code="P343",
                severity="warning",
            )


def _with_included(name: str, documents: dict[str, Document]) -> Iterator[Document]:
    """Yield the file of that name, and those that it includes in turn."""
    todo, seen = [name], set[str]()
    while todo:
        current = todo.pop()
        document = documents.get(current)
        if document is None or current in seen:
            continue
        seen.add(current)
        yield document
        entries = document.data.get("include")
        folder = posixpath.dirname(current)
        todo += [_normal(str(entry), folder) for entry in (entries if isinstance(entries, list) else ())]


def _normal(entry: str, folder: str) -> str:
    """Return the normal form of an included file's name; see `IncludeReader`."""
    if entry.startswith(IN_LIBRARY) and not entry.endswith((".yaml", ".yml")):
        return entry
    return posixpath.normpath(posixpath.join(folder, entry))


def breakpoints(survey: LintModel) -> Iterator[Diagnostic]:
    """P344: a breakpoint that was left in the file."""
    for place in survey.places():
        if place.spec.breakpoint is not None:
            message = f"a breakpoint is set here, {place.spec.breakpoint} {place.spec.name}"
            hint = "only 'run --debug' stops at it"
            yield survey.fault(place.spec, message, hint, code="P344", at="breakpoint")

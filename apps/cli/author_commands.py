"""Commands of an author: check, explain-code, lsp, nodes, rehearse, render, schema."""

from __future__ import annotations

import shutil
import sys
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from picktree.files import PicktreeError

from .options import JsonResult, JunitFile, OtherRobot, TextFile, mission_file
from .output import (
    end_with,
    json_text,
    keep_stdout,
    painter,
    print_answer,
    print_warnings,
    require_place,
    show,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from picktree.trees import NodeDeclaration
    from picktree.trees.loading import NodeRegistry


def registry(*, shipped: bool = False) -> NodeRegistry:
    """Return all installed nodes, or with `shipped` only those that come with picktree.

    Plug-ins that cannot be imported are reported on stderr; their nodes are missing.
    """
    from picktree.trees.loading import NodeRegistry

    if shipped:
        from picktree.recovery import NODES as RECOVERY
        from picktree.skills import NODES as SKILLS

        return NodeRegistry((*RECOVERY, *SKILLS), installed=False)
    found = NodeRegistry()
    for problem in found.problems:
        print(f"{problem.message}; the plug-in's nodes are left out", file=sys.stderr)
    return found


def explain_code(
    code: Annotated[
        str | None, typer.Argument(metavar="CODE", help="Code, as P104; without it, all codes are listed.")
    ] = None,
    index: Annotated[
        bool, typer.Option("--index", help="Print the page of the documentation that lists all codes.")
    ] = False,
) -> None:
    """Explain a code of `picktree check`: the fault, its effect, and the remedy."""
    from picktree.files import fault_codes
    from picktree.files import index as all_codes

    if index:
        print(all_codes(), end="")
    elif code is None:
        for each in fault_codes.pages():
            print(f"{each.code}  {each.title}")
    elif sys.stdout.isatty():
        _show(fault_codes.page(code).text)
    else:
        print(fault_codes.page(code).text, end="")


def _show(markdown: str) -> None:
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(markdown, code_theme="ansi_dark"))


def check(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE…", help="Files of any kind; a folder: all its YAML files; -: stdin."),
    ],
    format_: Annotated[
        Literal["text", "json", "github", "sarif"],
        typer.Option(
            "--format", help="Format for people, programs, annotations on GitHub, or code scanning (SARIF)."
        ),
    ] = "text",
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 1 for warnings, too.")] = False,
    ours_only: Annotated[
        bool, typer.Option("--ours-only", help="Leave out files that are not picktree's, as in folders.")
    ] = False,
    stdin_filename: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File name of stdin; other files are looked for in its folder."),
    ] = None,
) -> None:
    """Check files of any kind, and report all errors of all files together. Exit code 2: there are errors."""
    from picktree.files import file_checks, file_system
    from picktree.files.yaml import file_text

    from .file_schemas import CHECKS

    def given(name: str) -> Path | file_checks.UnsavedText:
        if name != "-":
            return file_system.known_file(name) or Path(name)
        return file_checks.UnsavedText(
            stdin_filename or Path("<stdin>"), sys.stdin.buffer.read(file_text.MAX_BYTES + 1)
        )

    report = file_checks.check_files([given(name) for name in files], CHECKS, ours_only=ours_only)
    match format_:
        case "text":
            print(report.to_text(painter(sys.stdout)))
        case "github":
            print(report.to_github())
        case "json":
            print(report.to_json_text(), end="")
        case "sarif":
            from picktree import __version__
            from picktree.files import file_checks

            print(file_checks.to_sarif(report, __version__, Path.cwd()), end="")
    raise typer.Exit(report.exit_code(strict=strict))


def nodes(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Node to describe in full.")] = None,
    mission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Also the nodes of this mission's plug-ins, and its sub-trees.",
            parser=mission_file,
        ),
    ] = None,
    shipped: Annotated[
        bool, typer.Option("--shipped", help="Only the nodes that come with picktree.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print them as one JSON object.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page of the documentation with all of them.")
    ] = False,
    stub: Annotated[
        bool, typer.Option("--stub", help="Print a Python stub of their constructors, for editors.")
    ] = False,
    output: TextFile = None,
) -> None:
    """List the nodes that a mission may use; with a NAME its ports, causes and an example."""
    import orjson

    from picktree.authoring.schema import markdown as reference_page
    from picktree.authoring.schema import node_reference

    known = registry(shipped=shipped)
    trees = _sub_trees(mission, known) if mission else ()
    if stub:
        from picktree.authoring.schema import stub as stub_text

        show(stub_text(known.declarations()), output)
        return
    declared = (*known.declarations(), *trees)
    causes = known.causes
    if name is not None:
        library = () if any(node.id == name for node in declared) else _library_trees(known)
        declared = (_named(name, (*declared, *library)),)
    entries = tuple(node_reference.node_entry(node, causes, known.find(node.id)) for node in declared)
    if json:
        listed = {"nodes": [asdict(entry) for entry in entries]}
        text = orjson.dumps(listed, option=orjson.OPT_INDENT_2).decode() + "\n"
    elif markdown:
        text = reference_page(entries, causes)
    else:
        text = node_reference.table(entries) if name is None else node_reference.page(entries[0])
    show(text, output)


def _named(name: str, declared: tuple[NodeDeclaration, ...]) -> NodeDeclaration:
    from picktree.files import suggest_name
    from picktree.trees.loading import foreign_word

    for node in declared:
        if node.id == name:
            return node
    hint = foreign_word(name) or suggest_name(name, [node.id for node in declared])
    raise PicktreeError(f"there is no node {name!r}" + (f" ({hint})" if hint else ""))


def _sub_trees(path: Path, known: NodeRegistry, *, included: bool = True) -> tuple[NodeDeclaration, ...]:
    """Return the mission's sub-trees as nodes; the nodes of its plug-ins are added to `known`.

    Without `included` only those of the file itself.
    """
    from picktree.authoring.schema import one_mission
    from picktree.files.yaml import read_document
    from picktree.trees import MAIN, NodeDeclaration

    document = read_document(path, "mission")
    mission, own = one_mission(document, known), document.data.get("trees")
    return tuple(
        NodeDeclaration(name, mission.docs.get(name) or f"A sub-tree of {path.name}.", "subtree", ports)
        for name, ports in mission.trees.items()
        if name != MAIN and (included or (isinstance(own, dict) and name in own))
    )


def _library_trees(known: NodeRegistry) -> Iterator[NodeDeclaration]:
    """Yield the sub-trees that come with picktree, each with the `include` that it takes."""
    from picktree.trees import LIBRARY, NodeDeclaration, library_names

    for library in library_names():
        path = LIBRARY / f"{library}.yaml"
        for tree in _sub_trees(path, known, included=False):
            taken = f"A sub-tree of picktree's library: a mission takes it by 'include: [library/{library}]'."
            yield NodeDeclaration(tree.id, f"{tree.doc} {taken}", "subtree", tree.ports)


def rehearse(
    mission: Annotated[
        Path,
        typer.Argument(metavar="MISSION", help="Mission file, or a shipped example.", parser=mission_file),
    ],
    cases: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Cases file.", show_default="cases/MISSION beside the mission"),
    ] = None,
    case: Annotated[
        list[str] | None, typer.Option("--case", metavar="NAME", help="Only this case; may be repeated.")
    ] = None,
    robot: OtherRobot = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Verdicts without traces.")] = False,
    full_coverage: Annotated[
        bool, typer.Option("--full-coverage", help="Exit code 1 also when a node or branch is not reached.")
    ] = False,
    min_recovery_coverage: Annotated[
        int,
        typer.Option(
            metavar="PERCENT",
            min=0,
            max=100,
            help="Exit code 1 also when cases reach less than PERCENT of the branches of recovery.",
        ),
    ] = 0,
    causes: Annotated[
        bool, typer.Option("--causes", help="List the declared causes that no case raises.")
    ] = False,
    junit: JunitFile = None,
    json: JsonResult = False,
) -> None:
    """Rehearse a mission without physics: its leaves answer as the cases say. Exit code 1: a case failed."""
    answer = keep_stdout() if json else None

    from picktree.authoring.rehearsal import rehearsal

    if case and min_recovery_coverage:
        raise PicktreeError("--min-recovery-coverage is about all cases: leave out --case")
    require_place(junit)
    result = rehearsal.rehearse_files(mission, cases, case or (), robot)
    print_warnings(result.warnings)
    print_answer(
        answer,
        lambda: rehearsal.to_text(result, quiet=quiet, causes=causes),
        lambda: json_text(rehearsal.to_json(result)),
    )
    gaps = rehearsal.coverage_gaps(result.coverage, full=full_coverage, recovery=min_recovery_coverage)
    for gap in gaps:
        print(gap, file=sys.stderr)
    if junit is not None:
        show(rehearsal.to_junit(result, gaps), junit)
    end_with(result.passed and not gaps)


def render(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Mission file, or a shipped example.", parser=mission_file),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="PICTURE", help="A .svg, .html, .dot or .txt file; without: text, here."
        ),
    ] = None,
    expand: Annotated[
        bool, typer.Option("--expand", help="Write each sub-tree out wherever it is called.")
    ] = False,
) -> None:
    """Draw a mission: its trees, ports, conditions, and handlers of failures."""
    from picktree.authoring import DEFAULT_COLUMNS, drawing, mission_chart, text

    suffix = drawing.suffix_of(output.name) if output is not None else ".txt"
    charted = mission_chart.chart_of_file(file)
    if output is None:
        columns = (
            shutil.get_terminal_size((DEFAULT_COLUMNS, 0)).columns if sys.stdout.isatty() else DEFAULT_COLUMNS
        )
        show(text(charted, columns=columns, expand=expand), None)
        return
    show(drawing.drawing_text(charted, suffix, expand=expand), output)
    print(output)


class Kind(StrEnum):
    """Kinds of files that people write by hand."""

    MISSION = "mission"
    SCENE = "scene"
    ROBOT = "robot"
    FAULTS = "faults"
    CASES = "cases"
    PLAN = "plan"


def schema(
    kind: Annotated[Kind, typer.Argument(help="The kind of file.")],
    mission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Schema for this mission, with its sub-trees, its plug-ins' nodes and its scene's names.",
            parser=mission_file,
        ),
    ] = None,
    shipped: Annotated[
        bool,
        typer.Option("--shipped", help="Only the nodes that come with picktree, none of installed plug-ins."),
    ] = False,
    markdown: Annotated[
        bool,
        typer.Option("--markdown", help="Print the page of the documentation with all keys of the kind."),
    ] = False,
    output: TextFile = None,
) -> None:
    """Print the JSON Schema of a kind of file, by which editors complete, explain and underline."""
    from picktree.authoring.schema import to_text

    from .file_schemas import file_schema

    if kind is not Kind.MISSION:
        if mission is not None:
            raise PicktreeError(f"--mission is for the schema of missions, not of {kind.value}")
        found = file_schema(kind.value)
        if markdown:
            from picktree.authoring.schema import file_reference

            show(file_reference(kind.value, found).page(kind.value), output)
            return
    elif markdown:
        raise PicktreeError(
            "docs/language.md has the keys of missions, 'picktree nodes --markdown' the nodes"
        )
    else:
        from picktree.authoring.schema import any_mission, mission_schema, one_mission
        from picktree.files.yaml import read_document

        nodes = registry(shipped=shipped)
        particular = any_mission()
        if mission is not None:
            particular = one_mission(read_document(mission, "mission"), nodes)
        found = mission_schema(nodes, particular)
    show(to_text(found), output)


def lsp() -> None:
    """Serve an editor by the language server protocol, over stdin and stdout."""
    from picktree import __version__
    from picktree.logs import optional_import

    answer = keep_stdout()
    with optional_import("lsp", "pygls", "The language server"):
        from .language_server import serve

    serve(sys.stdin.buffer, answer.buffer, __version__)

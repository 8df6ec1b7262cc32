"""picktree check"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..terminal.output import painter


def explain_code(
    code: Annotated[
        str | None, typer.Argument(metavar="CODE", help="As P104; without it, all codes are listed.")
    ] = None,
    index: Annotated[
        bool, typer.Option("--index", help="Print the page of the documentation that lists all codes.")
    ] = False,
) -> None:
    """Explain a code of `picktree check`: what is wrong, why it matters, how to mend it."""
    from ...files.diagnostics.fault_codes import index as all_codes
    from ...files.diagnostics.fault_codes import page, pages

    if index:
        print(all_codes(), end="")
    elif code is None:
        for each in pages():
            print(f"{each.code}  {each.title}")
    elif sys.stdout.isatty():
        _show(page(code).text)
    else:
        print(page(code).text, end="")


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
        Literal["text", "json", "github"],
        typer.Option("--format", help="For people, for programs (one object), for annotations on GitHub."),
    ] = "text",
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 1 for warnings, too.")] = False,
    stdin_filename: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="What stdin is called, and beside which file it stands."),
    ] = None,
) -> None:
    """Check files of any kind: all faults of all files at once. Exit code 2: there are errors."""
    from ...files.diagnostics.file_checks import UnsavedText, check_files
    from ...files.yaml.file_text import MAX_BYTES
    from .file_kinds import CHECKS

    def given(name: str) -> Path | UnsavedText:
        if name != "-":
            return Path(name)
        return UnsavedText(stdin_filename or Path("<stdin>"), sys.stdin.buffer.read(MAX_BYTES + 1))

    report = check_files([given(name) for name in files], CHECKS)
    match format_:
        case "text":
            print(report.to_text(painter(sys.stdout)))
        case "github":
            print(report.to_github())
        case "json":
            print(report.to_json_text(), end="")
    raise typer.Exit(report.exit_code(strict=strict))

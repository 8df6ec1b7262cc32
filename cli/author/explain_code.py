"""picktree explain-code"""

from __future__ import annotations

import sys
from typing import Annotated

import typer


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

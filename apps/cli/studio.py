"""picktree studio"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def studio(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder with missions, scenes, plans and runs.")
    ] = Path("."),
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, metavar="N", help="0: any that is free.", show_default="8420 or next"),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the link.")] = True,
) -> None:
    """Show a folder's runs in the browser, on this machine alone. Ctrl-C ends it; runs continue.

    Without a browser, or with --no-browser, open the link that is printed.
    """
    from importlib import import_module

    from picktree.logs import optional_import

    for library in ("starlette", "uvicorn", "websockets"):
        with optional_import("studio", library, "picktree studio"):
            import_module(library)

    from picktree.apps.studio import serve

    def ready(link: str) -> None:
        print(f"picktree studio of {folder.resolve()}\n{link}", flush=True)
        print("Ctrl-C ends it.", file=sys.stderr)
        if browser:
            typer.launch(link)

    serve(folder, port, ready)

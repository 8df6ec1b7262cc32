"""Command `convert`: missions as XML of BehaviorTree.CPP 4, and such XML as missions."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from picktree.files import PicktreeError

from .options import mission_file
from .output import print_warnings

_ENUM = re.compile(r"([A-Za-z_]\w*)=(-?\d{1,9})", re.ASCII)


def convert(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE…", help="A mission, or XML: files, a folder of them, or -: stdin."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="OUT", help="File or folder for the converted form.", show_default="stdout"
        ),
    ] = None,
    stubs: Annotated[
        Path | None,
        typer.Option(
            metavar="PY", help="Write a plug-in with a stub for each unknown node; the mission names it."
        ),
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(metavar="PY", help="Plug-in with nodes of the XML; the mission names it."),
    ] = None,
    main: Annotated[
        str, typer.Option(metavar="TREE", help="Tree of the XML that becomes the mission's tree 'Main'.")
    ] = "",
    enum: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Value of an enum name in the XML's scripts."),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse XML with content that has no meaning for a run.")
    ] = False,
) -> None:
    """Turn a mission into XML of BehaviorTree.CPP 4 and Groot2, and such XML into a mission."""
    from picktree.authoring.xml import ImportOptions, XmlText, convert_all, read_files
    from picktree.files.yaml import file_text

    if "-" in files:
        if len(files) > 1:
            raise PicktreeError("stdin (-) is read alone, without other files")
        stdin = Path("<stdin>")
        values = [
            XmlText(file_text.decoded(sys.stdin.buffer.read(file_text.MAX_BYTES + 1), str(stdin)), stdin)
        ]
    else:
        values = read_files([Path(name) if Path(name).is_dir() else mission_file(name) for name in files])
    sources = [file.path for file in values if file.path.exists()]
    if out is not None and out.exists() and any(map(out.samefile, sources)):
        raise PicktreeError(f"{out} is the file that is read; give another one with -o")
    folder = out.parent if out is not None else values[0].path.parent
    options = ImportOptions(
        strict=strict,
        main=main,
        plugins=tuple(_beside(each, folder) for each in plugin or ()),
        folder=folder,
        stubs=_beside(stubs, folder) if stubs is not None else "",
        enums=dict(map(_enum, enum or ())),
    )
    if stubs is not None and stubs.exists():
        raise PicktreeError(f"{stubs} is there already; move it away, or use it with --plugin {stubs}")
    converted = convert_all(values, options)
    print_warnings(converted.notes)
    if stubs is not None and converted.stubs:
        _write(stubs, converted.stubs)
    if out is None:
        print(converted.text, end="")
    else:
        _write(out, converted.text)


def _enum(text: str) -> tuple[str, int]:
    match = _ENUM.fullmatch(text)
    if match is None:
        raise PicktreeError(f"--enum {text!r}: it is a name and a whole number, as RED=1")
    return match[1], int(match[2])


def _beside(file: Path, folder: Path) -> str:
    """Return the name by which a mission in the folder names a plug-in's file. Raises PicktreeError."""
    name = os.path.relpath(file, folder)
    if name.startswith("..") or not name.endswith(".py"):
        message = f"{file} is not a Python file in the mission's folder {folder or Path()}"
        raise PicktreeError(
            f"{message}; a mission can only name plug-ins in that folder or in its subfolders"
        )
    return Path(name).as_posix()


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise PicktreeError(f"{path} cannot be written: {error.strerror or error}") from None

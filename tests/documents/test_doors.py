"""What documents and examples import is public: it stands in a door above `# for other rooms`."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from ..import_contracts import read_doors
from ..rooms import ROOT

IMPORT = re.compile(r"^\s*(?:>>> )?(from picktree[\w.]* import (?:\([^)]*\)|[^\n#(]+))", re.MULTILINE)
OPEN = ("picktree", "picktree.skills.plugin")
"""Modules whose names are all public."""


def public_names() -> set[tuple[str, str]]:
    found = set[tuple[str, str]]()
    for door in read_doors():
        stub = ROOT.joinpath(*door.split(".")[1:], "__init__.pyi").read_text(encoding="utf-8")
        for node in ast.parse(stub.partition("# for other rooms")[0]).body:
            if isinstance(node, ast.ImportFrom):
                found |= {(door, alias.name) for alias in node.names}
    return found


def imports(file: Path) -> Iterator[tuple[str, str]]:
    for statement in IMPORT.findall(file.read_text(encoding="utf-8")):
        (node,) = ast.parse(statement).body
        assert isinstance(node, ast.ImportFrom)
        yield from ((node.module or "", alias.name) for alias in node.names)


def test_documents_and_examples_import_public_names() -> None:
    files = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.py")]
    imported = {(door, name, file.name) for file in files for door, name in imports(file) if door not in OPEN}
    assert len(imported) > 30
    public = public_names()
    assert [each for each in sorted(imported) if each[:2] not in public] == []
    assert 140 < len(public) < 260

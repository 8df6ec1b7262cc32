"""Each Python block of README.md and docs/ imports what there is, under its present name, and uses no other.

The blocks of a page are one program, as its reader has it; a file is one of its own. Parts of skills stand in
a method of one.
"""

from __future__ import annotations

import ast
import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import dedent, indent

import pytest

from ..pages import Block, blocks, pages
from ..rooms import ROOT

OPTIONAL = {"pandas", "duckdb"}
"""Libraries of a reader's own."""
GIVEN = {
    "item": "ObjectId",
    "object_in_tcp": "Pose",
    "over": "Pose",
    "over_the_bin": "tuple[Pose, ...]",
    "goal": "PoseGoal",
    "still_held": "Any",
    "plan": "Any",
    "folder": "Any",
    "onlooker": "Any",
}
"""Names that parts of skills and programs take for given, with their types."""
SHOWN = [block for page in pages() for block in blocks(page, "python")]
UNTYPED = {"measurements.md", "batches.md"}
"""Pages whose programs use libraries without types."""
HEAD = """from typing import Any
from pathlib import Path
from picktree.skills.plugin import ObjectId, Pose, PoseGoal, Skill, Steps, World
"""
GIVEN_ARGUMENTS = ", ".join(f"{name}: {kind}" for name, kind in GIVEN.items())


def parsed(block: Block) -> ast.Module:
    return ast.parse(dedent(block.text))


def imports(tree: ast.AST) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)


@pytest.mark.parametrize("block", SHOWN, ids=lambda block: block.where)
def test_a_block_imports_what_there_is(block: Block) -> None:
    for module, name in imports(parsed(block)):
        if module not in OPTIONAL:
            found = importlib.import_module(module)
            assert not name or hasattr(found, name), f"{block.where}: {module} has no {name}"


def is_part(block: Block) -> bool:
    """A part of a skill or of a program: it waits for something, or takes a name for given."""
    tree = parsed(block)
    outside = [node for node in tree.body if not isinstance(node, ast.ClassDef | ast.FunctionDef)]
    nodes = [each for node in outside for each in ast.walk(node)]
    stored = {each.id for each in nodes if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)}
    loaded = {each.id for each in nodes if isinstance(each, ast.Name)} - stored
    waits = any(isinstance(each, ast.Yield | ast.YieldFrom) for each in nodes)
    return waits or bool(loaded & {"world", "self", "folder"})


def programs(page: Path) -> dict[str, str]:
    """Return by name of a file: each file that the page shows, and its other blocks as one program."""
    name = page.stem.replace("-", "_")
    alone = {
        f"{name}_{number}.py": dedent(block.text)
        for number, block in enumerate(blocks(page, "python"))
        if block.file
    }
    return {f"{name}.py": program([b for b in blocks(page, "python") if not b.file]), **alone}


def program(shown: Sequence[Block]) -> str:
    parts = [HEAD]
    for number, block in enumerate(shown):
        text = dedent(block.text)
        if is_part(block):
            lines = "\n".join(line for line in text.splitlines() if line.strip() != "...")
            parts += re.findall(
                r"^(?:from|import) .*$", lines, re.MULTILINE
            )  # for the page's later parts, too
            text = f"def _part_{number}(self: Skill, world: World, {GIVEN_ARGUMENTS}) -> Any:\n"
            text += indent(lines, "    ")
        parts.append(f"# {block.where}\n{text}\n")
    return "\n".join(parts)


@pytest.mark.slow
def test_a_type_checker_knows_all_names_of_the_blocks(tmp_path: Path) -> None:
    for page in pages():
        if blocks(page, "python") and page.name not in UNTYPED:
            for name, text in programs(page).items():
                (tmp_path / name).write_text(text, encoding="utf-8")
    settings = {
        "typeCheckingMode": "basic",
        "extraPaths": [str(ROOT / "links")],
        "stubPath": str(ROOT / "tests" / "typings"),
        "reportMissingImports": False,
        "reportMissingModuleSource": False,
        "reportOptionalMemberAccess": False,
        "reportAttributeAccessIssue": "error",
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    pyright = Path(sys.executable).with_name("pyright")
    ran = subprocess.run(
        [str(pyright), "--outputjson", "--pythonpath", sys.executable, "-p", str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    found = json.loads(ran.stdout)
    assert found["summary"]["filesAnalyzed"] > 15
    lines = {file.name: file.read_text().splitlines() for file in tmp_path.glob("*.py")}
    errors = [
        f"{name}: {lines[name][each['range']['start']['line']].strip()}: {each['message']}"
        for each in found["generalDiagnostics"]
        if each["severity"] == "error"
        for name in [Path(each["file"]).name]
        if "objct" not in lines[name][each["range"]["start"]["line"]]  # what the page shows as wrong
    ]
    assert errors == [], "\n".join(errors)

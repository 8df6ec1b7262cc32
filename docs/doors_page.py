"""Page of the public names of each package, as its `__init__.pyi` lists them.

python docs/doors_page.py > docs/doors.md
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HEAD = """# Doors

What each package offers to documents, plug-ins, tests and your own programs. Import a name from its package,
as `from picktree.robot.planning import LineGoal`; the module behind it may change. A stub, `__init__.pyi`, is
the list. What other packages of picktree need stands there, too, below `# for other rooms`, and may change
without notice. A plug-in finds all that it needs in `picktree.skills.plugin` ([plugins.md](plugins.md)).
"""


def first_sentence(text: str | None) -> str:
    paragraph = " ".join((text or "").partition("\n\n")[0].split())
    return paragraph.partition(". ")[0].rstrip(".:")


def public_names(stub: Path) -> Iterator[tuple[str, str]]:
    """Yield module and name of each public name of a door."""
    text = stub.read_text(encoding="utf-8").partition("# for other rooms")[0]
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module or alias.name, alias.name) for alias in node.names)


def documented(module: Path) -> dict[str, str]:
    """Return the first sentence of the docstring of each name at the top of a module."""
    body = ast.parse(module.read_text(encoding="utf-8")).body
    found = {
        node.name: first_sentence(ast.get_docstring(node))
        for node in body
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
    }
    for node, after in pairwise(body):
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            match node:
                case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                    found[name] = first_sentence(str(after.value.value))
                case _:
                    pass
    return found


def page() -> str:
    parts = [HEAD]
    rooms = sorted(file.parent for file in ROOT.glob("*/__init__.py"))
    for stub in sorted(stub for room in rooms for stub in room.rglob("__init__.pyi")):
        names = sorted((name, module) for module, name in public_names(stub))
        if not names:
            continue
        folder = stub.parent.relative_to(ROOT)
        about = ast.get_docstring(ast.parse(stub.with_suffix(".py").read_text(encoding="utf-8")))
        sentences = {module: documented(stub.parent / f"{module}.py") for _, module in names}
        rows = [f"| `{name}` | {sentences[module].get(name, '')} |" for name, module in names]
        heading = f"## picktree.{'.'.join(folder.parts)}"
        parts += [heading, "", f"{first_sentence(about)}.", "", "| name | |", "|---|---|", *rows, ""]
    return "\n".join(parts)


if __name__ == "__main__":
    print(page(), end="")

"""Executes the cells of a notebook as a kernel does: the last expression of a cell is shown.

    python notebook.py FILE.ipynb

It prints a line for each cell: the forms in which the cell's value can be shown.
"""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

FORMS = ("_repr_html_", "_repr_svg_", "_repr_png_")


def code_cells(notebook: Path) -> list[dict[str, object]]:
    return [c for c in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]


def execute(notebook: Path) -> list[list[str]]:
    """The forms of each cell's value that were made; those of `repr` are left out."""
    names: dict[str, object] = {}
    shown: list[list[str]] = []
    for cell in code_cells(notebook):
        tree = ast.parse("".join(cell["source"]))  # type: ignore[arg-type]
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, str(notebook), "exec"), names)
        value = None
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), str(notebook), "eval"), names)
        repr(value)
        made = [form for form in FORMS if getattr(type(value), form, None) and getattr(value, form)()]
        shown.append(made)
    return shown


if __name__ == "__main__":
    for forms in execute(Path(sys.argv[1])):
        print(*forms)

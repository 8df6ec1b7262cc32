"""The one import of plug-ins: it has what it says, types and values alike, and documents use no other."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from picktree.skills import plugin

ROOT = Path(__file__).parents[2]
PAGES = {
    f"{page.relative_to(ROOT)}:{number}": text
    for page in (ROOT / "docs").glob("*.md")
    for number, text in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
}
PROGRAMS = {str(file.relative_to(ROOT)): file.read_text() for file in (ROOT / "examples").rglob("*.py")}
PLUGINS = {where: text for where, text in (PAGES | PROGRAMS).items() if re.search(r"^NODES = ", text, re.M)}


def typed() -> dict[str, str]:
    """The names that a type checker sees, with their modules."""
    (block,) = (
        node for node in ast.parse(Path(plugin.__file__).read_text()).body if isinstance(node, ast.If)
    )
    return {
        alias.name: node.module or ""
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_it_has_the_names_that_a_type_checker_sees() -> None:
    assert dir(plugin) == sorted(typed())
    for name, module in typed().items():
        found = __import__(module, fromlist=[name])
        assert getattr(plugin, name) is getattr(found, name)
    with pytest.raises(AttributeError, match=r"module 'picktree.skills.plugin' has no attribute 'Dance'"):
        _ = plugin.Dance  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType, reportUnknownMemberType]


@pytest.mark.parametrize("where", PLUGINS)
def test_a_shown_plug_in_imports_from_there_alone(where: str) -> None:
    imported = re.findall(r"^(?:from|import) (picktree[\w.]*)", PLUGINS[where], re.MULTILINE)
    assert set(imported) == {"picktree.skills.plugin"}


def test_plug_ins_are_shown_in_documents_examples_and_templates() -> None:
    assert {"docs/plugins.md", "docs/safety.md"} <= {where.partition(":")[0] for where in PLUGINS}
    assert {"examples/plugins/probe.py", "examples/templates/plugin/lift.py"} <= PLUGINS.keys()

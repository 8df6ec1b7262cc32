"""docs/cookbook.md as its reader does it: files, programs and commands in order, with what is printed."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from ..pages import Reader, blocks, recipes
from ..rooms import ROOT

PAGE = ROOT / "docs" / "cookbook.md"


def test_it_has_four_recipes() -> None:
    assert list(recipes(PAGE)) == ["Own mesh", "From CAD to item", "Reject by weight", "Own camera"]
    assert sum(block.language == "text" for block in blocks(PAGE)) == 4


@pytest.mark.slow
@pytest.mark.parametrize("recipe", recipes(PAGE))
def test_a_recipe_works(recipe: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    reader = Reader(tmp_path)
    for block in recipes(PAGE)[recipe]:
        if block.file is not None:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        match block.language:
            case "python":
                assert block.file is not None
                runpy.run_path(str(tmp_path / block.file))
            case "sh":
                reader.type(block)
            case "text":
                reader.compare(block)
            case _:
                pass

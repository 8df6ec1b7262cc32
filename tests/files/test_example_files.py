"""Shipped examples by their names, from any folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import PicktreeError
from picktree.files.file_system import EXAMPLES, example_file, known_file
from picktree.files.yaml.file_text import Unreadable, read_bytes


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_name_is_a_shipped_example() -> None:
    assert example_file("sort_by_colour") == EXAMPLES / "sort_by_colour.yaml"
    assert example_file("slip", "faults") == EXAMPLES / "faults" / "slip.yaml"
    assert known_file("sort_by_colour") == EXAMPLES / "sort_by_colour.yaml"


def test_a_file_of_that_name_comes_first(tmp_path: Path) -> None:
    own = tmp_path / "sort_by_colour.yaml"
    own.touch()
    assert example_file("sort_by_colour").samefile(own)
    bare = tmp_path / "one_pick"
    bare.touch()
    assert example_file("one_pick") == Path("one_pick")


@pytest.mark.parametrize("path", ["a/sort_by_color", "none.yaml", "./sort_by_colour", "m.xml"])
def test_a_path_stays_as_it_is(path: str) -> None:
    assert example_file(path) == Path(path)
    assert known_file(path) is None


@pytest.mark.parametrize("name", ["sort_by_color", "sort_by_color.yaml"])
def test_a_name_that_is_not_found_has_near_names(tmp_path: Path, name: str) -> None:
    (tmp_path / "sort_by_colours.yaml").touch()
    with pytest.raises(PicktreeError) as caught:
        example_file(name)
    near = "did you mean 'sort_by_colour' or 'sort_by_colours'?"
    assert str(caught.value) == f"there is no mission '{name}', neither a file here nor an example ({near})"


def test_a_missing_file_has_near_names_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "picking.yaml").touch()
    (tmp_path / "picking.txt").touch()
    with pytest.raises(Unreadable) as caught:
        read_bytes(tmp_path / "pikcing.yaml", 10)
    assert (caught.value.message, caught.value.hint) == (
        "there is no such file",
        "did you mean 'picking.yaml'?",
    )
    with pytest.raises(Unreadable) as caught:
        read_bytes(tmp_path / "sorting.yaml", 10)
    assert caught.value.hint == ""

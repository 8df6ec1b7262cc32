"""Names of files that a file system refuses, or that no text can hold."""

import os
from pathlib import Path

import pytest

from picktree.files import PicktreeError
from picktree.files.file_system import MAX_NAME_BYTES, fitted, is_utf8, require_utf8, whole

LATIN_1 = os.fsdecode(b"caf\xe9")


@pytest.mark.parametrize("name", ["n" * 300, "n" * 300 + ".html", "ü" * 200 + ".mcap"])
def test_a_long_name_is_cut_and_stays_unique(name: str) -> None:
    cut = fitted(name)
    assert len(os.fsencode(cut)) <= MAX_NAME_BYTES
    assert cut != fitted(name[1:])
    assert fitted(cut) == cut
    assert is_utf8(cut)
    assert Path(cut).suffix == Path(name).suffix


def test_a_name_that_is_not_utf8_is_refused_with_its_bytes() -> None:
    require_utf8(Path("café/ü"))
    with pytest.raises(PicktreeError) as raised:
        require_utf8(Path("runs") / LATIN_1)
    assert str(raised.value) == r"runs/caf\xe9: the name is not UTF-8; rename it"


@pytest.mark.parametrize("length", [230, 250, 255])
def test_the_longest_name_is_written_whole(tmp_path: Path, length: int) -> None:
    path = tmp_path / ("n" * (length - 5) + ".html")
    with whole([path], path) as (beside,):
        beside.write_text("page")
    assert [each.read_text() for each in tmp_path.iterdir()] == ["page"]


def test_a_name_that_is_too_long_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 300)
    with pytest.raises(PicktreeError, match="cannot be written: file name too long"), whole([path], path):
        pass


def test_a_refused_file_leaves_neither_itself_nor_its_new_folders(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "tables"
    with (
        pytest.raises(PicktreeError, match="cannot be written: no space left on device"),
        whole([folder / "a.csv"], folder) as (beside,),
    ):
        folder.mkdir(parents=True)
        beside.write_text("half")
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []

"""Every code has a page, every page is used, and its examples do what they say."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from picktree.apps.cli.file_schemas import CHECKS
from picktree.authoring.xml import ImportOptions, XmlText, convert_all
from picktree.files import FileError, PicktreeError, index
from picktree.files.fault_codes import CodeExample, page, pages
from picktree.files.file_checks import UnsavedText, check_files
from picktree.trees.loading import PLUGINS_VARIABLE

from ..rooms import ROOT, modules

MISSION = "picktree: 1\nkind: mission\n"


def codes_in_sources() -> set[str]:
    texts = (file.read_text(encoding="utf-8") for file in modules())
    return {code for text in texts for code in re.findall(r"[\"'](P\d{3})[\"']", text)}


def codes_of(example: CodeExample, folder: Path) -> set[str]:
    """The codes of all that is wrong with an example, in a folder that holds the example missions."""
    for file in (ROOT / "examples").glob("*.yaml"):
        shutil.copy(file, folder)
    if example.text.startswith("$ picktree check "):
        path = folder / example.text.removeprefix("$ picktree check ")
        return {fault.code for fault in check_files([path], CHECKS).faults}
    text = f"{MISSION}{example.text}" if example.text.startswith("trees:") else example.text
    raw = f"{text}\n".encode()
    if example.language == "text":  # bytes that a page cannot show are written \xe9
        raw = re.sub(rb"\\x([0-9a-f]{2})", lambda match: bytes([int(match[1], 16)]), raw)
    return {fault.code for fault in check_files([UnsavedText(folder / "example.yaml", raw)], CHECKS).faults}


def codes_of_conversion(example: CodeExample, folder: Path) -> set[str]:
    """The codes of what keeps an example from being converted, and of the notes."""
    text = f"{MISSION}{example.text}\n" if example.language == "yaml" else example.text
    file = XmlText(text, folder / f"example.{example.language}")
    try:
        return {note.code for note in convert_all([file], ImportOptions()).notes}
    except FileError as error:
        return {fault.code for fault in error.faults}


def write_files(explanation: str, folder: Path) -> None:
    """The files that a page shows before its examples; their first line is their name."""
    shown = r"```(?:python|yaml)\n# (\w+\.(?:py|yaml))\n(.*?)```"
    for name, source in re.findall(shown, explanation, re.DOTALL):
        (folder / name).write_text(source)


def test_every_code_has_a_page_and_every_page_is_used() -> None:
    written, used = {each.code for each in pages()}, codes_in_sources()
    assert sorted(used - written) == [], "codes without a page"
    assert sorted(written - used) == [], "pages that no source uses"


@pytest.mark.parametrize("code", [each.code for each in pages()])
def test_the_examples_of_a_page(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if code == "P262":
        monkeypatch.setenv(PLUGINS_VARIABLE, "refuse")
    explained = page(code)
    write_files(explained.explanation, tmp_path)
    assert explained.wrong.text != explained.right.text
    if code.startswith("P9"):
        assert code in codes_of_conversion(explained.wrong, tmp_path)
        assert codes_of_conversion(explained.right, tmp_path) == set()
        return
    assert code in codes_of(explained.wrong, tmp_path)
    assert code not in codes_of(explained.right, tmp_path)


def test_a_page_is_found_in_small_letters_and_an_unknown_one_named() -> None:
    assert page("p104").title == "Unknown key"
    with pytest.raises(PicktreeError) as caught:
        page("P1044")
    assert str(caught.value) == "there is no code 'P1044' (did you mean 'P104'?)"
    with pytest.raises(PicktreeError) as caught:
        page("nonsense")
    assert str(caught.value) == "there is no code 'nonsense' (`picktree explain-code` lists all)"


def test_the_index_is_up_to_date() -> None:
    """`picktree explain-code --index > docs/codes.md` makes it anew."""
    assert (ROOT / "docs" / "codes.md").read_text(encoding="utf-8") == index()

"""The report of a run as a file: whole in itself, from whatever the log holds."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.report.report import TREE_SCRIPTS, report
from picktree.apps.cli import answer


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


@pytest.fixture(scope="module")
def text(troubled_log: Path) -> str:
    with Run(troubled_log) as run:
        return report(run)


def test_page_is_whole_in_itself(text: str) -> None:
    tags = Tags(text).found
    outside = [
        (tag, name, value)
        for tag, attributes in tags
        for name, value in attributes.items()
        if name in ("src", "href", "action") and value != "data:,"
    ]
    assert outside == []
    policy = next(found["content"] for tag, found in tags if found.get("http-equiv"))
    assert policy is not None and policy.startswith("default-src 'none'; script-src 'sha256-")
    assert policy.count("'sha256-") == len(TREE_SCRIPTS) + 1
    assert "unsafe-eval" not in policy
    assert not re.search(r"@import|url\(", re.findall(r"<style>.*?</style>", text, re.DOTALL)[0])


def test_page_says_without_scripts_what_it_is_of_and_is_the_same_each_time(
    text: str, troubled_log: Path
) -> None:
    assert "<title>sort by colour, sort_small, seed 0</title>" in text
    assert re.search(r"<noscript>.*sort by colour, seed 0: .*items sorted.*</noscript>", text)
    with Run(troubled_log) as run:
        assert report(run) == text


def test_the_terminal_says_what_of_a_damaged_log_is_missing(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("typer.launch", opened.append)
    cut, page = tmp_path / "cut.mcap", tmp_path / "a page.html"
    cut.write_bytes(troubled_log.read_bytes()[: troubled_log.stat().st_size * 9 // 10])
    assert answer(["report", str(cut), "-o", str(page), "--json", "--open"]) == 0
    told = capsys.readouterr()
    with Run(cut) as run:
        assert told.err == f"{run.recovered}\n"
        assert "recovered up to byte" in run.recovered
    assert json.loads(told.out)["file"] == str(page)
    assert opened == [page.as_uri()]


def test_command_writes_the_page_and_says_so(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    assert answer(["report", str(troubled_log.parent), "-o", str(page)]) == 0
    out, _ = capsys.readouterr()
    assert re.fullmatch(rf"{page}: \d\.\d MB for \d+ simulated s, made in \d+\.\d s\n", out)
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert [file.name for file in tmp_path.iterdir()] == ["r.html"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("r.pdf", "a report is an HTML page; name it r.html"),
        ("none/r.html", "cannot be written: no such file or directory"),
        ("folder.html", "cannot be written: is a directory"),
    ],
)
def test_command_refuses_what_it_cannot_write(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, said: str
) -> None:
    (tmp_path / "folder.html").mkdir()
    assert answer(["report", str(troubled_log), "-o", str(tmp_path / name)]) == 2
    assert capsys.readouterr().err.removeprefix(f"{tmp_path}/{name}").lstrip(": ") == f"{said}\n"
    assert [file.name for file in tmp_path.iterdir()] == ["folder.html"]

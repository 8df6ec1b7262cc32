"""The report of a run as a file: whole in itself, from whatever the log holds."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.report import write_report
from picktree.analysis.report.report import TREE_SCRIPTS, pack_run, report
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


def test_page_says_without_scripts_what_it_is_of(text: str) -> None:
    assert "<title>sort by colour, sort_small, seed 0</title>" in text
    assert re.search(r"<noscript>.*sort by colour, seed 0: .*items sorted.*</noscript>", text)


def test_the_terminal_says_what_of_a_damaged_log_is_missing(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(troubled_log.read_bytes()[: troubled_log.stat().st_size * 9 // 10])
    assert answer(["report", str(cut), "-o", str(tmp_path / "cut.html"), "--json"]) == 0
    told = capsys.readouterr()
    with Run(cut) as run:
        assert told.err == f"{run.recovered}\n"
        assert "recovered up to byte" in run.recovered
    assert json.loads(told.out)["file"] == str(tmp_path / "cut.html")


def test_same_log_gives_the_same_page(text: str, troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        assert report(run) == text


def test_command_writes_the_page_and_says_so(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    assert answer(["report", str(troubled_log.parent), "-o", str(page)]) == 0
    out, _ = capsys.readouterr()
    assert re.fullmatch(rf"{page}: \d\.\d MB for \d+ simulated s, made in \d+\.\d s\n", out)
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert [file.name for file in tmp_path.iterdir()] == ["r.html"]
    assert answer(["report", str(troubled_log), "-o", str(page), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["file"], said["bytes"]) == (str(page), page.stat().st_size)


def test_command_opens_the_page_when_asked(
    troubled_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("typer.launch", opened.append)
    page = tmp_path / "a page.html"
    assert answer(["report", str(troubled_log), "-o", str(page), "--open"]) == 0
    assert opened == [page.as_uri()]


def test_command_refuses_what_it_cannot_write(
    troubled_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["report", str(troubled_log), "-o", str(tmp_path / "r.pdf")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/r.pdf: a report is an HTML page; name it r.html\n"
    assert answer(["report", str(troubled_log), "-o", str(tmp_path / "none" / "r.html")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/none/r.html cannot be written: no such file or directory\n"
    (tmp_path / "folder.html").mkdir()
    assert answer(["report", str(troubled_log), "-o", str(tmp_path / "folder.html")]) == 2
    assert capsys.readouterr().err == f"{tmp_path}/folder.html cannot be written: is a directory\n"
    assert [file.name for file in tmp_path.iterdir()] == ["folder.html"]


def test_log_of_a_killed_run_is_reported_with_a_word_of_it(troubled_log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    shutil.copy(troubled_log, cut)
    with cut.open("r+b") as file:
        file.truncate(cut.stat().st_size * 2 // 3)
    with Run(cut) as run:
        assert run.recovered
        written = write_report(run, tmp_path / "r.html")
        section = pack_run(run).data
        assert isinstance(section, dict)
        assert section["notes"] == [run.recovered]
        outcome = section["outcome"]
        assert isinstance(outcome, dict)
        assert (outcome["word"], outcome["kind"], outcome["items"]) == ("killed", "open", "")
    assert written.bytes > 100_000

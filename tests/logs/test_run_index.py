"""Run index: rows of all runs below a folder, filters, the cache, deletion."""

from __future__ import annotations

import fcntl
import io
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.files import PicktreeError
from picktree.logs import RunResult, run_index
from picktree.logs.run_index import COLUMNS, RunFilter, RunIndex, RunRow
from picktree.session.run_recipe import make_folder

from .rewriting import Content


@pytest.fixture
def runs(tmp_path: Path, picked: RunResult, troubled_log: Path) -> Path:
    """Folder with a run that succeeded, and a newer one in which an item was snatched away."""
    for name, log, time in (("one_pick-0", picked.log, 1000), ("sort-0", troubled_log, 2000)):
        folder = tmp_path / f"{name}-20261123-09000{time // 1000}"
        shutil.copytree(log.parent, folder)
        os.utime(folder / "log.mcap", (time, time))
    return tmp_path


def rows(folder: Path, where: str | None = None) -> list[RunRow]:
    return list(RunIndex(folder).select(None if where is None else RunFilter.parse(where)))


def test_a_row_says_what_the_result_says(runs: Path, picked: RunResult) -> None:
    newest, first = rows(runs)
    assert (first.mission, first.scene, first.backend, first.seed) == (
        "one pick",
        "sort_small",
        "kinematic",
        0,
    )
    assert (first.status, first.sorted, first.total) == ("success", picked.items.sorted, picked.items.total)
    assert (first.lost, first.cause, first.seconds) == (0.0, "", picked.sim_seconds)
    assert (newest.folder, newest.log) == (f"{newest.folder}", f"{newest.folder}/log.mcap")
    result = json.loads((runs / newest.folder / "result.json").read_text(encoding="utf-8"))
    assert newest.lost == round(sum(each["seconds"] for each in result["cures"]), 3) > 0
    assert set(newest.causes) == set(result["failures"])
    assert newest.cause == max(result["cures"], key=lambda each: each["seconds"])["cause"]


def test_a_filter_has_the_names_of_the_columns(runs: Path) -> None:
    newest, first = rows(runs)
    assert rows(runs, "lost > 0 and status in ['success', 'incomplete', 'failure']") == [newest]
    assert rows(runs, f"{newest.cause!r} in causes") == [newest]
    assert rows(runs, "mission == 'one pick' and sorted < total") == [first]
    assert rows(runs, "age > 10000 and len(folder) > 0") == [newest, first]
    assert set(COLUMNS) == set(first.names(0.0))


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("sede > 3", "--where 'sede > 3': unknown name 'sede'; did you mean 'seed'?, at character 1"),
        (
            "status == 'sucess'",
            "--where \"status == 'sucess'\": this is never 'sucess'; did you mean 'success'?, "
            "at character 11",
        ),
        (
            "mission > 3",
            "--where 'mission > 3': '>' does not work on a text and a whole number, at character 9",
        ),
    ],
)
def test_a_filter_that_cannot_hold_is_refused(where: str, said: str) -> None:
    with pytest.raises(PicktreeError) as error:
        RunFilter.parse(where)
    assert str(error.value) == said


def test_a_killed_run_has_no_result_and_no_comparison_with_it_holds(runs: Path) -> None:
    log = runs / rows(runs)[0].log
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) * 2 // 3])
    (killed,) = rows(runs, "status == 'killed'")
    assert (killed.mission, killed.sorted, killed.lost) == ("sort by colour", None, None)
    assert killed.seconds is not None and killed.seconds > 0
    assert killed not in rows(runs, "sorted < 100") and killed not in rows(runs, "not (sorted < 100)")
    log.write_bytes(b"no log")
    (broken,) = rows(runs, "status == 'unreadable'")
    assert broken.message


def test_a_run_that_goes_on_is_read_once_and_again_at_its_end(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = runs / rows(runs)[0].log
    index, opened = RunIndex(runs), count_opened(monkeypatch)
    with log.open("r+b") as writing:
        fcntl.flock(writing, fcntl.LOCK_EX)
        whole = log.read_bytes()
        log.write_bytes(whole[: len(whole) * 2 // 3])
        assert [row.status for row in index.rows()] == ["running", "success"]
        before = len(opened)
        log.write_bytes(whole[: len(whole) * 3 // 4])
        assert [row.status for row in index.rows()] == ["running", "success"]
        assert len(opened) == before
        with pytest.raises(PicktreeError, match=r"the run is in progress; halt it first$"):
            index.delete(next(index.rows()))
        log.write_bytes(whole)
    assert next(index.rows()).status != "running"


def test_a_run_whose_process_dies_without_another_write_is_killed(runs: Path) -> None:
    log = runs / rows(runs)[0].log
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) * 2 // 3])
    index = RunIndex(runs)
    with log.open("rb") as writing:
        fcntl.flock(writing, fcntl.LOCK_EX)
        assert [row.status for row in index.rows()] == ["running", "success"]
    assert [row.status for row in index.rows()] == ["killed", "success"]


def count_opened(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    opened: list[object] = []
    real = run_index.RunLog

    def opening(where: Path) -> object:
        opened.append(where)
        return real(where)

    monkeypatch.setattr(run_index, "RunLog", opening)
    return opened


def test_only_new_and_changed_logs_are_opened_again(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = count_opened(monkeypatch)
    before = rows(runs)
    assert len(opened) == 2
    assert rows(runs) == before and len(opened) == 2
    os.utime(runs / before[1].log, (3000, 3000))
    assert [row.log for row in rows(runs)] == [before[1].log, before[0].log] and len(opened) == 3
    next(RunIndex(runs).rows())  # stopped after the first row: the other one stays known
    assert len(rows(runs)) == 2 and len(opened) == 3


def test_further_files_of_a_rotated_log_are_no_runs(runs: Path) -> None:
    first = rows(runs)[1]
    shutil.copy(runs / first.log, runs / first.folder / "log-0002.mcap")
    assert len(rows(runs)) == 2
    assert next(row for row in rows(runs) if row.log == first.log).size == 2 * first.size


def test_links_are_not_followed(runs: Path) -> None:
    (runs / "loop").symlink_to(runs, target_is_directory=True)
    assert len(rows(runs)) == 2


def test_a_runs_folder_is_deleted_with_all_that_is_in_it(tmp_path: Path, picked: RunResult) -> None:
    folder = make_folder(tmp_path, "one_pick", 3)
    shutil.copytree(picked.folder, folder, dirs_exist_ok=True)
    (folder / "report.html").write_text("", encoding="utf-8")
    index = RunIndex(tmp_path)
    index.delete(next(index.rows()))
    assert list(tmp_path.iterdir()) == []


def test_of_another_folder_the_log_alone_is_deleted(tmp_path: Path, picked: RunResult) -> None:
    work = tmp_path / "my work"
    work.mkdir()
    for name in ("log.mcap", "log-0002.mcap"):
        shutil.copy(picked.log, work / name)
    (work / "thesis.txt").write_text("years", encoding="utf-8")
    index = RunIndex(tmp_path)
    index.delete(next(index.rows()))
    assert [path.name for path in work.iterdir()] == ["thesis.txt"]


def test_runs_of_a_batch_stay(runs: Path) -> None:
    (runs / "results.sqlite").touch()
    index = RunIndex(runs)
    with pytest.raises(PicktreeError, match="belongs to the batch"):
        index.delete(next(index.rows()))
    assert len(rows(runs)) == 2


def test_the_command_lists_filters_and_prunes(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    newest, first = rows(runs)
    assert answer(["runs", str(runs)]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    names = "written status sorted units/h MTBF lost s seed mission cause folder"
    assert head.split() == names.split()
    assert [line.split()[-1] for line in lines] == [newest.folder, first.folder]
    assert answer(["runs", str(runs), "--prune"]) == 2
    assert "choose them with --where CONDITION or --keep N" in capsys.readouterr().err
    assert answer(["runs", str(runs), "--keep", "1", "--prune", "--yes"]) == 0
    assert capsys.readouterr().err == f"1 of 1 runs, {first.size / 1e6:.1f} MB deleted\n"
    assert rows(runs) == [newest]
    assert answer(["runs", str(runs / "nowhere")]) == 2


def test_nothing_is_deleted_where_nobody_can_be_asked(
    runs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert answer(["runs", str(runs), "--where", "seed == 0", "--prune"]) == 2
    assert "give --yes when there is no terminal to confirm it" in capsys.readouterr().err
    assert len(rows(runs)) == 2


def test_a_folder_that_is_not_utf8_is_named_and_the_others_are_listed(
    tmp_path: Path, log_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in (b"caf\xe9", b"fine"):
        folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
        folder.mkdir()
        shutil.copy(log_path, folder / "log.mcap")
    for _ in range(2):  # the second time from the cache
        found = {row.folder: row for row in rows(tmp_path)}
        assert set(found) == {"fine", r"caf\xe9"}
        assert found["fine"].status == "killed"  # the sample's result is none of a session
        assert found[r"caf\xe9"].message == r"caf\xe9/log.mcap: the name is not UTF-8; rename it"
    assert answer(["runs", str(tmp_path)]) == 0
    assert "unreadable" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["explain"], ["export", "--to", "csv", "-o", "x"], ["resim", "--json"]])
def test_a_name_that_is_not_utf8_is_one_sentence(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer([*command, os.fsdecode(b"caf\xe9")]) == 2
    assert capsys.readouterr().err == "caf\\xe9: the name is not UTF-8; rename it\n"


def test_a_log_whose_result_was_left_out_is_not_called_killed(tmp_path: Path, picked: RunResult) -> None:
    content = Content.of(picked.log)
    replace(content, metadata=[]).write(tmp_path / "log.mcap")
    (row,) = rows(tmp_path)
    assert (row.status, row.seed, row.mission) == ("unknown", None, "unknown mission")

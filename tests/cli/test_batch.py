"""The command `picktree batch`."""

import json
from pathlib import Path

import pytest

from picktree.apps.batch import local_executor
from picktree.apps.cli import answer

from ..commands import forked_worker

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"


def test_a_batch_is_run_asked_and_gone_on_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_executor, "_started", forked_worker)
    folder = str(tmp_path / "night")
    options = ["--mission", str(ONE_PICK), "--seeds", "0:2", "--backend", "kinematic", "--workers", "1"]
    assert answer(["batch", "run", *options, "--out", folder]) == 0
    told = capsys.readouterr().out
    assert "2 jobs, 1 worker; in " in told
    assert "goal reached  2 of 2 (100.0 %, 34.2 … 100.0 %)" in told
    assert answer(["batch", "query", folder, "SELECT seed, status FROM jobs", "--csv"]) == 0
    assert capsys.readouterr().out == "seed,status\r\n0,success\r\n1,success\r\n"
    assert answer(["batch", "run", "--resume", folder]) == 0
    assert "2 jobs, 2 done before" in capsys.readouterr().out
    assert answer(["batch", "summary", folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recipes"][0]["success"]["total"] == 2
    assert answer(["batch", "compare", folder, folder]) == 0
    assert "no significant difference in these runs" in capsys.readouterr().out


def test_a_scene_is_looked_for_where_run_looks_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scene is looked up in the working directory, not beside the mission; its suffix may be left out."""
    monkeypatch.setattr(local_executor, "_started", forked_worker)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kitchen.yaml").write_text("picktree: 1\nkind: scene\nbase: sort_small\n")
    for name in ("kitchen.yaml", "kitchen"):
        options = ["--mission", str(ONE_PICK), "--scene", name, "--seeds", "0", "--backend", "kinematic"]
        assert answer(["batch", "run", *options, "--out", str(tmp_path / name.replace(".", "-"))]) == 0
        assert "goal reached  1 of 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "give one of: a plan file, --mission FILE, --resume DIR"),
        (["--mission", str(ONE_PICK), "--seeds", "3:1"],
         "--seeds: seeds '3:1': the range '3:1' is empty: write 0:100 (half open), 3,7 or both"),
        (["--mission", str(ONE_PICK), "--limit", "3 k"],
         "--limit: '3 k': unknown unit 'k' (s, ms, us, min, h)"),
        (["--mission", str(ONE_PICK), "--set", "Grasp.forse=1,2"],
         "Grasp.forse: Grasp has no input 'forse' (did you mean 'force'?)"),
        (["--resume", "/nowhere", "--wall-limit", "3 s"],
         "--wall-limit can only be given with --mission: the batch has its own value"),
        (["night.yaml", "--seeds", "0:2"], "--seeds can only be given with --mission: the plan file has its "
        "own "
        "value"),
        (["--resume", "/nowhere"], "/nowhere: not a batch: there is no plan.json in this folder"),
    ],
)  # fmt: skip
def test_what_cannot_be_run_is_refused_at_once(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["batch", "run", *options]) == 2
    assert capsys.readouterr().err == f"{message}\n"

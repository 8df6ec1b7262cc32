"""`picktree diff` on logs of real runs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.session import RunRequest, Session

EXAMPLES = Path(__file__).parents[2] / "examples"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 2, delay: 500 ms}, target: {nearest_to: object}}
"""


def run(out: Path, faults: str = "", seed: int = 3) -> Path:
    """The folder of a run without physics."""
    planted = None
    if faults:
        out.mkdir(parents=True, exist_ok=True)
        planted = out / "faults.yaml"
        planted.write_text(faults)
    request = RunRequest(
        mission=EXAMPLES / "sort_by_colour.yaml",
        scene="sort_small",
        backend="kinematic",
        seed=seed,
        faults=planted,
        out=out,
    )
    return Session(request).run().folder


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("faulty"), FAULTS)


def test_a_run_is_identical_with_itself(plain: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["diff", str(plain), str(plain / "log.mcap")]) == 0
    assert "identical: every simulated message is the same" in capfd.readouterr().out


def test_a_planted_fault_is_where_the_runs_part(
    plain: Path, faulty: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert answer(["diff", str(plain), str(faulty), "--json"]) == 1
    said = json.loads(capfd.readouterr().out)
    assert said["files"] == [{"name": "faults.yaml", "how": "only_b", "diff": []}]
    assert (said["first_value"]["topic"], said["first_value"]["missing"]) == ("/events", "a")
    assert said["first_value"]["b"]["kind"] == "fault"
    parting = said["parting"]
    assert (parting["a"]["id"], parting["a"]["outcome"]) == ("Grasp", "SUCCESS")
    assert (parting["b"]["outcome"], parting["b"]["cause"]) == ("FAILURE", "grasp.missed")
    assert (
        parting["a"]["item"]
        == parting["b"]["item"]
        == said["first_value"]["b"]["data"]["colour"] + (f"_{said['first_value']['b']['data']['kind']}_1")
    )
    assert parting["next_b"]["id"] == "SafeRetreat"
    assert parting["time"] > said["first_value"]["time"]
    ended = {item["b"]["id"]: item["b"]["state"] for item in said["items"] if item["differs"]}
    assert ended == {parting["b"]["item"]: "gone"}


def test_another_seed_is_another_table(
    plain: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert answer(["diff", str(plain), str(run(tmp_path, seed=4)), "--json"]) == 1
    said = json.loads(capfd.readouterr().out)
    assert said["settings"] == [{"name": "seed", "a": 3, "b": 4}]
    assert {pair["basis"] for pair in said["item_pairs"]} <= {"order"}


def test_the_python_of_its_page_runs(
    plain: Path,
    faulty: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    page = (EXAMPLES.parent / "docs" / "compare.md").read_text()
    found = re.search(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert found is not None
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "a").symlink_to(plain)
    (tmp_path / "runs" / "b").symlink_to(faulty)
    monkeypatch.chdir(tmp_path)
    exec(compile(found[1], "compare.md", "exec"), {})
    shown = capfd.readouterr().out
    assert "Divergence(time=" in shown and "Difference(tick=" in shown and "SUCCESS FAILURE" in shown

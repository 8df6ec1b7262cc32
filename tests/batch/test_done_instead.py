"""An item that a mission rejects counts the same in every output, and its cause is no root cause."""

from __future__ import annotations

import shutil
from pathlib import Path

from picktree.analysis import Run
from picktree.analysis.explain import explain_runs, runs_text, to_text
from picktree.apps.batch import Batch, BatchPlan, Executor, Store, summarise
from picktree.session import RunRequest, Session

from .watching import Remembering

EXAMPLES = Path(__file__).parents[2] / "examples"
SCENE = """
picktree: 1
kind: scene
base: sort_small
fixtures:
  quarantine: {bin: [0.25, 0.20, 0.10], wall: 5 mm, at: [0.12, -0.48, 0]}
destinations:
  - {where: "kind == 'can'", to: quarantine}
  - {where: "colour == 'red'", to: red_bin}
  - {where: "colour == 'green'", to: green_bin}
  - {where: "colour == 'blue'", to: blue_bin}
"""
MISSION = """
picktree: 1
kind: mission
name: reject
scene: scene.yaml
include: [library/recovery]
plugins: [plugins/weigh.py]
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach: {in: "{items}", out: "{item}", do: {SortOne: {item: "{item}"}}}
  SortOne:
    ports: {item: {type: object}}
    Recover:
      attempts: 2
      do:
        - Grasp: {object: "{item}"}
        - Weigh: {most: 110 g}
        - Place: {object: "{item}", into: "{item.destination}"}
      instead: {weigh.heavy: REJECT}
      otherwise: SafeRetreat
"""
INTO_QUARANTINE = '{Place: {object: "{item}", into: quarantine}}'
AND_SET_ASIDE = f'[{INTO_QUARANTINE}, {{SetAside: {{object: "{{item}}"}}}}]'
ON_THE_TABLE = '[PutDown, {SetAside: {object: "{item}"}}]'


def write_mission(folder: Path, reject: str) -> None:
    (folder / "plugins").mkdir()
    shutil.copy(EXAMPLES / "plugins" / "weigh.py", folder / "plugins")
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "mission.yaml").write_text(MISSION.replace("REJECT", reject))


def run_batch(folder: Path, reject: str, worker: Executor) -> Path:
    write_mission(folder, reject)
    plan = BatchPlan("reject", (folder / "mission.yaml",), (3, 7), backend="kinematic", keep="all")
    with Batch.create(folder / "batch", plan) as batch:
        assert batch.run(worker, Remembering())
    return folder / "batch"


def test_a_rejected_item_is_done_in_every_output(tmp_path: Path, worker: Executor) -> None:
    """`test_counts_agree.py` compares the counts of the outputs."""
    by, rejected = "Place + SetAside", 0
    folder = run_batch(tmp_path, AND_SET_ASIDE, worker)
    for log in sorted(folder.glob("**/log.mcap")):
        with Run(log) as run:
            result, found, text = run.result, run.explanation, to_text(run, run.explanation, str(log))
        assert result is not None
        assert (result.status, result.items.sorted) == ("success", result.items.total)
        assert (found.root_causes, "Root cause" in text) == ((), False)
        count = len(found.failures)
        for failure in found.failures:
            assert (failure.cause, failure.fate, failure.root_cause) == ("weigh.heavy", "done_instead", None)
            (handling,) = failure.handled_by
            assert (handling.handler, handling.ran, handling.ended) == ("weigh.heavy", by, "SUCCESS")
            assert failure.seconds_lost == 0.0
            assert f"weigh.heavy  {count} seen, {count} done instead ({by})" in result.to_text()
            assert "ran this handler instead of the branch, as the mission asks." in " ".join(text.split())
        rejected += count
    assert rejected > 0
    runs = explain_runs(folder)
    assert (runs.causes, runs.items[0]) == ((), runs.items[1])
    assert f"weigh.heavy  {rejected} seen, {rejected} done instead ({by})" in runs_text(runs)
    with Store(folder / "results.sqlite") as store:
        summary = summarise(store)
        views = store.query("SELECT cause, seen, cured, done_instead, share FROM cures_by_cause").rows
    (cures,) = summary.together.cures
    assert (cures.total.seen, cures.total.to_cure, cures.total.done_instead) == (rejected, 0, rejected)
    assert summary.together.roots == ()
    assert views == (("weigh.heavy", rejected, 0, rejected, None),)
    assert f"{by} instead {rejected}" in summary.to_text()


def test_a_rejected_item_that_is_left_is_told_by_what_was_done_to_it(
    tmp_path: Path, worker: Executor
) -> None:
    """The goal is missed, and what the skill found is not the reason: the mission put the item down."""
    for log in sorted(run_batch(tmp_path, ON_THE_TABLE, worker).glob("**/log.mcap")):
        with Run(log) as run:
            result, found = run.result, run.explanation
        assert result is not None
        assert {root.cause for root in found.root_causes} <= {"mission.put_elsewhere"}
        states = [item.state for item in found.items]
        assert (states.count("done"), states.count("aside")) == (result.items.sorted, result.items.left)


def test_what_fails_while_an_item_is_rejected_is_the_root_cause(tmp_path: Path) -> None:
    """The item slips on its way into quarantine: neither its weight nor the rejection is to blame."""
    write_mission(tmp_path, INTO_QUARANTINE)
    (tmp_path / "faults.yaml").write_text(
        "picktree: 1\nkind: faults\nfaults:\n"
        "  - {fault: slip, when: {node: Place, start: 4, delay: 300 ms}, lasts: 400 ms}\n"
    )
    request = RunRequest(
        tmp_path / "mission.yaml", seed=3, backend="kinematic", faults=tmp_path / "faults.yaml", out=tmp_path
    )
    with Run(Session(request).run().log) as run:
        failures, roots = run.explanation.failures, run.explanation.root_causes
    heavy, slipped = failures[0], failures[1]
    assert (heavy.cause, heavy.handled_by[-1].instead, heavy.root_cause) == ("weigh.heavy", True, None)
    assert (slipped.cause, slipped.because_of, slipped.root_cause) == ("grasp.slipped", heavy.number, 0)
    assert [root.cause for root in roots] == ["item.slipped"]

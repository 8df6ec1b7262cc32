"""All outputs of one batch agree on its failures: how many, how each ended, and what time was lost.

Items are rejected by `instead`, one slips and is cured, one is snatched away and is given up.
"""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import explain_runs, runs_json_text, runs_text, to_json_text, to_text
from picktree.apps.batch import Batch, BatchPlan, Executor, Store, dropped_logs, summarise
from picktree.logs.episode_counts import ENDS, by_cause
from picktree.logs.run_index import RunIndex

from .test_done_instead import SCENE
from .watching import Remembering

EXAMPLES = Path(__file__).parents[2] / "examples"
MISSION = """
picktree: 1
kind: mission
name: reject and recover
scene: scene.yaml
include: [library/recovery]
plugins: [plugins/weigh.py]
trees:
  Main:
    Repeat:
      while: items_left
      num_cycles: 2
      do:
        Sequence:
          - Observe: {camera: overhead, objects: "{items}"}
          - ForEach: {in: "{items}", out: "{item}", on_failure: continue, do: {SortOne: {item: "{item}"}}}
  SortOne:
    ports: {item: {type: object}}
    Fallback:
      - Recover:
          attempts: 3
          do:
            - Grasp: {object: "{item}", onward: false}
            - Weigh: {most: 110 g}
            - Place: {object: "{item}", into: "{item.destination}"}
          instead: {weigh.heavy: {Place: {object: "{item}", into: quarantine}}}
          when: {grasp.*: RetreatAndLook, world.*: RetreatAndLook}
          otherwise: [SafeRetreat]
      - EmptyTheHand
"""
FAULTS = """
picktree: 1
kind: faults
faults:
  - {fault: slip, when: {node: Weigh, start: 2, delay: 100 ms}, lasts: 400 ms}
  - {fault: remove, when: {node: Grasp, start: 4, delay: 300 ms}, target: {nearest_to: object}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, worker: Executor) -> Path:
    made = tmp_path_factory.mktemp("agree")
    (made / "plugins").mkdir()
    shutil.copy(EXAMPLES / "plugins" / "weigh.py", made / "plugins")
    for name, text in (("scene", SCENE), ("mission", MISSION), ("faults", FAULTS)):
        (made / f"{name}.yaml").write_text(text)
    plan = BatchPlan(
        "agree",
        (made / "mission.yaml",),
        (3, 7),
        faults=(made / "faults.yaml",),
        backend="kinematic",
        keep="all",
    )
    with Batch.create(made / "batch", plan) as batch:
        assert batch.run(worker, Remembering())
    return made / "batch"


def runs_of(folder: Path) -> list[Path]:
    return sorted(log.parent for log in folder.glob("**/log.mcap"))


def test_each_run_agrees_with_itself(folder: Path) -> None:
    ends: Counter[str] = Counter()
    for place in runs_of(folder):
        with Run(place) as run:
            result, found = run.result, run.explanation
            text, told = to_text(run, found, str(place)), json.loads(to_json_text(run, found))
        assert result is not None
        assert result.cures is not None
        episodes, failures = found.recovery.episodes, found.failures
        ends.update(episode.end for episode in episodes)
        # Each failure ends as its episode does, and each episode has its failures.
        for failure in failures:
            assert failure.episode is not None
            end = episodes[failure.episode].end
            assert (failure.cured, failure.done_instead) == (end == "cured", end == "done_instead")
            assert (failure.fate == "open") == (end == "open")
        assert {failure.episode for failure in failures} == set(range(len(episodes)))
        # Time lost: the same sum by failures, episodes, root causes and result.
        lost = sum(episode.seconds for episode in episodes)
        assert lost > 0.0
        for other in (
            sum(failure.seconds_lost for failure in failures),
            sum(root.seconds_lost for root in found.root_causes),
            sum(cure.seconds for cure in result.cures),
            sum(failure["seconds_lost"] for failure in told["failures"]),
        ):
            assert other == pytest.approx(lost, abs=1e-6)
        # The result is counted while the run goes on, the explanation from the log.
        assert result.cures == found.recovery.cures
        written = json.loads((place / "result.json").read_text())
        assert written["cures"] == json.loads(json.dumps([asdict(cure) for cure in result.cures]))
        # Headings of both parts of the text.
        by_end = Counter(episode.end for episode in episodes)
        heading = ", ".join(f"{by_end[end]} {word}" for end, word in ENDS.items() if by_end[end])
        assert f"Recovery ({len(episodes)} episodes: {heading}; {lost:.1f} s lost)" in text
        fates = Counter(failure.fate for failure in failures)
        (title,) = re.findall(rf"^Failures \({len(failures)}: (.*)\)$", text, re.MULTILINE)
        words = {"cured": "cured", "done_instead": "done instead", "branched": "went another way"}
        assert title == ", ".join(f"{fates[fate]} {word}" for fate, word in words.items() if fates[fate])
        # Planted faults: as the episodes, and as what became of the items.
        planted = {(each.fault, each.cause): each.end for each in found.recovery.planted if each.cause}
        assert planted == {("slip", "grasp.slipped"): "cured", ("remove", "grasp.missed"): "given_up"}
        assert {("slip", "cured"), ("remove", "given_up")} <= {(p.fault, p.end) for p in result.planted}
        gone = next(root for root in found.root_causes if root.cause == "item.gone")
        cures = [episode.end for episode in episodes if episode.item == gone.item]
        assert gone.ended_run
        assert set(cures) == {"given_up"}
        assert [item.state for item in found.items if item.id == gone.item] == ["gone"]
        # Handler runs are what the log announces, whatever came of them.
        handlings = sum(sum(h.handler != "again" for h in f.handled_by) for f in failures)
        assert sum(result.recoveries.values()) == handlings
    assert min(ends[end] for end in ("cured", "done_instead", "given_up")) >= 2


def test_batch_and_runs_agree(folder: Path) -> None:
    results = []
    for place in runs_of(folder):
        with Run(place) as run:
            results.append((run.result, run.explanation))
    failures = Counter(failure.cause for _, found in results for failure in found.failures)
    runs = explain_runs(folder)
    with Store(folder / "results.sqlite") as store:
        summary = summarise(store)
        summary_text = summary.to_text()
        causes = {row[0]: row[1:] for row in store.query("SELECT * FROM causes").rows}
        cures = {
            row[0]: row[1:]
            for row in store.query(
                "SELECT cause, seen, cured, done_instead, seconds FROM cures_by_cause"
            ).rows
        }
        by_root = dict(store.query("SELECT root_cause, count(*) FROM jobs GROUP BY root_cause").rows)
    expected = {each.cause: each.total for each in runs.cures}
    together = by_cause(cure for result, _ in results if result and result.cures for cure in result.cures)
    assert {each.cause: each.total for each in together} == expected
    assert {each.cause: each.total for each in summary.together.cures} == expected
    assert {cure["cause"] for cure in json.loads(runs_json_text(runs))["cures"]} == set(expected)
    for cause in summary.together.causes:
        total = expected[cause.cause]
        assert cause.failures == failures[cause.cause]
        assert cause.seconds_lost == pytest.approx(total.seconds)
        assert (cause.cured > 0, cause.done_instead > 0) == (total.cured > 0, total.done_instead > 0)
        assert (cause.cured == cause.failures) == (total.cured == total.seen)
        counted = (cause.failures, cause.cured, cause.done_instead, cause.jobs)
        assert causes[cause.cause] == (*counted, pytest.approx(total.seconds))
        ends = (total.seen, total.cured, total.done_instead)
        assert cures[cause.cause] == (*ends, pytest.approx(total.seconds))
        assert f"{total.seconds:9.1f}" in summary_text
        assert f"{cause.cause:<{max(map(len, expected))}}  {total.seen} seen" in runs_text(runs)
    # The summary counts one root cause of each job; the folder's explanation says how often each is it.
    firsts = {root.cause: root.first for root in runs.causes if root.first}
    assert firsts == {root.cause: root.jobs for root in summary.together.roots} == by_root
    assert "first root cause" in summary_text
    assert {root.cause for root in runs.causes} > set(firsts)


def test_the_list_of_runs_names_no_cause_that_was_done_instead(folder: Path) -> None:
    for row in RunIndex(folder).rows():
        with Run(folder / row.log) as run:
            episodes = run.explanation.recovery.episodes
        assert row.lost == pytest.approx(sum(episode.seconds for episode in episodes), abs=1e-3)
        assert row.cause not in ("", "weigh.heavy")
        assert "weigh.heavy" in row.causes


def test_a_folder_without_all_logs_says_where_all_figures_are(folder: Path, tmp_path: Path) -> None:
    copied = tmp_path / "some"
    shutil.copytree(folder, copied)
    assert dropped_logs(copied) == ""
    assert dropped_logs(tmp_path) == ""
    with Store(copied / "results.sqlite") as store:
        job = store.jobs()[0]
        store.set_folder(job.id, "")
    sentence = dropped_logs(copied)
    assert "no log of 1 of 2 jobs" in sentence
    assert f"picktree batch summary {copied}" in sentence
    found = explain_runs(copied, notes=[sentence])
    assert sentence in " ".join(runs_text(found).split())
    assert json.loads(runs_json_text(found))["notes"] == [sentence]

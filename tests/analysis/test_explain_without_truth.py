"""Explanations without ground truth: by what the robot saw, felt and believed."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.records import Attachment, Metadata

from picktree.analysis import Run
from picktree.analysis.explain import Explanation, explain, to_text
from picktree.analysis.explain.camera_causes import background_shift
from picktree.apps.cli import answer

from ..logs.rewriting import Content, Sent
from .test_explain_roots import BLOCK, MISSION, run

HIDDEN_EVENTS = frozenset({"fault", "fault_outcome", "crushed"})


def without_truth(log: Path, out: Path) -> Path:
    """Write a log as a robot would have: no truth, checkpoint, spawn, faults file or event, and no score."""
    content = Content.of(log)

    def known(sent: Sent) -> bool:
        hidden = sent.topic == "/events" and json.loads(sent.data)["kind"] in HIDDEN_EVENTS
        return not sent.topic.startswith("/truth/") and not hidden

    def files(file: Attachment) -> Attachment:
        if file.name != "scene.yaml":
            return file
        scene: dict[str, Any] = yaml.safe_load(file.data)
        scene.pop("spawn")
        return replace(file, data=yaml.safe_dump(scene, sort_keys=False).encode())

    def unscored(record: Metadata) -> Metadata:
        if "status" not in record.metadata:
            return record
        result = json.loads(record.metadata["json"])
        result["items"] |= {"total": 0, "sorted": 0, "misplaced": 0, "left": 0, "by_form": {}}
        result["planted"] = []
        ended = {"success": "incomplete", "incomplete": "success"}.get(result["status"], result["status"])
        result["status"] = ended
        return replace(record, metadata=record.metadata | {"status": ended, "json": json.dumps(result)})

    kept = [file for file in content.attachments if not file.name.startswith(("checkpoint", "faults"))]
    return replace(
        content,
        messages=[sent for sent in content.messages if known(sent)],
        attachments=[files(file) for file in kept],
        metadata=[unscored(record) for record in content.metadata],
    ).write(out)


def test_a_log_with_truth_is_explained_without_it_as_one_that_never_had_it(
    troubled_log: Path, tmp_path: Path
) -> None:
    bare = without_truth(troubled_log, tmp_path / "log.mcap")
    with Run(troubled_log, truth=False) as log, Run(bare) as other:
        found, same = log.explanation, other.explanation
        told = to_text(log, found, "LOG")
    assert not same.with_truth
    assert found == same
    (cause,) = found.root_causes
    assert (cause.cause, found.outcome.status, cause.planted) == ("item.gone", "incomplete", ())
    assert "as the robot believes" in found.outcome.sentence
    for word in ("truly", "truth:", "does not exist", "planted"):
        assert word not in told


def test_the_command_takes_the_option_and_the_simulation_is_not_loaded(
    troubled_log: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert answer(["explain", str(troubled_log), "--without-truth", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["with_truth"] is False
    script = (
        "import sys; from picktree.analysis import Run; from picktree.analysis.explain import to_text\n"
        f"with Run({str(troubled_log)!r}, truth=False) as run: to_text(run, run.explanation, 'LOG')\n"
        "loaded = {name for name in sys.modules if name.startswith('picktree.simulation.')}\n"
        "assert loaded <= {'picktree.simulation.truth'}, loaded"  # the type of a record of the log
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def seen(folder: Path) -> Explanation:
    with Run(folder) as log:
        return explain(log, truth=False)


AT_ONCE = "when: {at: 0 s}"


@pytest.mark.parametrize(
    ("fault", "cause", "word", "backend"),
    [
        ("{fault: bump, when: {node: Grasp, delay: 300 ms}, target: {nearest_to: object}, "
         "velocity: [0, 0.9, 0]}", "item.moved", "blue_block_1", "kinematic"),
        (f"{{fault: camera_shift, {AT_ONCE}, shift: [0, 30 mm, 0]}}", "camera.off", "3 cm", "kinematic"),
        ("{fault: heavier, when: {at: 0 s}, target: {kind: block}, mass: 400 g}", "", "", "kinematic"),
        ("{fault: wrench_bias, when: {node: Grasp}, force: [0, 0, 25 N], lasts: 4 s}", "wrist.biased",
         "that were not there", "kinematic"),
        ("{fault: slip, when: {node: Place, delay: 200 ms}, lasts: 400 ms}", "item.slipped", "blue_block_1",
         "physics"),
    ],
)  # fmt: skip
def test_a_cause_by_the_robots_own_sensors(
    tmp_path: Path, fault: str, cause: str, word: str, backend: Any
) -> None:
    found = seen(run(tmp_path, items=BLOCK, fault=fault, backend=backend))
    if not cause:
        assert [root for root in found.root_causes if root.ended_run] == []
        return
    assert found.root_causes[0].cause == cause
    assert word in found.root_causes[0].title


def test_a_clean_run_has_no_cause(tmp_path: Path) -> None:
    found = seen(run(tmp_path, items=BLOCK))
    assert (found.outcome.status, found.root_causes) == ("success", ())
    assert [item.truth for item in found.items] == ["by the belief in blue_bin, where it belongs"]


def test_a_wrong_bin_is_known_by_the_scenes_rules(tmp_path: Path) -> None:
    mission = MISSION.replace('into: "{item.destination}"', "into: red_bin")
    (cause,) = seen(run(tmp_path, items=BLOCK, mission=mission)).root_causes
    assert (cause.cause, cause.ended_run) == ("mission.wrong_bin", True)


@pytest.mark.parametrize("hidden", [False, True])
def test_a_shifted_picture_is_known_by_its_background(hidden: bool) -> None:
    scene = np.full((120, 160), 1.5)
    scene[30:60, 40:90] = 1.4
    scene[80:100, 100:130] = 1.42
    shifted = np.roll(scene, (3, -5), (0, 1))
    assert background_shift(scene, scene, 100.0) is None
    if hidden:
        shifted[:40, 60:] = 0.9  # something hides a part
    found = background_shift(shifted, scene, 100.0)
    assert found is not None
    assert found == pytest.approx((-5 * 0.0145, 3 * 0.0145), abs=0.002)

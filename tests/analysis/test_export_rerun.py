"""The recording for Rerun, read back with Rerun's own reader."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.export import export
from picktree.files import PicktreeError
from picktree.logs import RunResult


@pytest.fixture(scope="module")
def run(picked: RunResult) -> Iterator[Run]:
    with Run(picked.folder) as opened:
        yield opened


@pytest.fixture(scope="module")
def rrd(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    export(run, "rerun", path)
    return path


class Read:
    """The columns of every entity: by time (ns), or once where it is static."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader  # it takes half a second, and every worker collects this file

        self.chunks: dict[str, list[Any]] = {}
        for chunk in RrdReader(path).stream():
            self.chunks.setdefault(chunk.entity_path, []).append(chunk)

    def column(self, entity: str, component: str) -> list[tuple[int | None, Any]]:
        found: list[tuple[int | None, Any]] = []
        for chunk in self.chunks[entity]:
            batch = chunk.to_record_batch()
            names = [n for n in batch.schema.names if n.endswith(component)]
            if not names:
                continue
            values = batch.column(names[0]).to_pylist()
            times = (
                [None] * len(values)
                if chunk.is_static
                else [int(t) for t in np.array(batch.column("sim_time").cast("int64"))]
            )
            found += [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
        return sorted(found, key=lambda pair: pair[0] or 0)


@pytest.fixture(scope="module")
def read(rrd: Path) -> Read:
    return Read(rrd)


def test_every_link_has_its_mesh_once_and_a_pose_each_tick(run: Run, read: Read) -> None:
    times = [round(t * 1e9) for t in run.ticks.times]
    last = {t.child: t.pose for t in run.log.transforms_at(run.end).record}  # type: ignore[union-attr]
    for mesh in run.log.robot_model():
        entity = f"/world/robot/{mesh.link}"
        ((time, blob),) = read.column(f"{entity}/model", "Asset3D:blob")
        assert time is None and bytes(blob[0]) == mesh.glb
        moves = read.column(entity, "Transform3D:translation")
        assert [time for time, _ in moves] == times
        assert moves[-1][1][0] == pytest.approx(last[mesh.link].position, abs=1e-6)


def test_belief_and_truth_stand_where_the_log_says(run: Run, read: Read) -> None:
    believed = {body.id: body for body in run.at(run.end).belief.bodies}  # type: ignore[union-attr]
    assert believed
    for name in believed:
        assert read.column(f"/world/belief/{name}", "Transform3D:translation")
    true = run.at(run.end).truth
    assert true is not None
    for body in true.bodies:
        moves = read.column(f"/world/truth/{body.id}", "Transform3D:translation")
        assert moves[-1][1][0] == pytest.approx(body.pose.position, abs=1e-6)


def test_a_lane_is_coloured_from_beginning_to_end_and_then_empty(run: Run, read: Read) -> None:
    grasps = [visit for visit in run.visits if visit.id == "Grasp"]
    assert grasps
    ((_, values),) = read.column(f"/tree/{grasps[0].path}", "StateConfiguration:values")
    ((_, visible),) = read.column(f"/tree/{grasps[0].path}", "StateConfiguration:visible")
    assert [value for value, shown in zip(values, visible, strict=True) if not shown] == ["IDLE"]
    lane = read.column(f"/tree/{grasps[0].path}", "StateChange:state")
    assert lane == [
        change
        for visit in grasps
        for change in ((round(visit.start * 1e9), [visit.outcome]), (round(visit.end * 1e9), ["IDLE"]))
    ]


def test_steps_of_a_skill_have_a_lane_of_their_own(run: Run, read: Read) -> None:
    steps = [step for step in run.steps if step.node.endswith("Grasp") and step.end > step.start]
    lane = read.column(f"/tree/{steps[0].node}/steps", "StateChange:state")
    assert [(time, state) for time, (state,) in lane if state in ("approach", "close", "lift")] == [
        (round(step.start * 1e9), step.name) for step in steps if step.name != "weigh"
    ]


def test_signals_are_those_of_the_log(run: Run, read: Read) -> None:
    positions = read.column("/joints/position", "Scalars:scalars")
    assert np.array([v for _, v in positions]) == pytest.approx(run.joints.positions[:, :7])
    forces = read.column("/wrench/force", "Scalars:scalars")
    assert np.array([v for _, v in forces]) == pytest.approx(run.wrenches.forces)
    ((_, names),) = read.column("/joints/position", "SeriesLines:names")
    assert names == list(run.joints.names[:7])
    opening = read.column("/gripper/opening", "Scalars:scalars")
    assert max(v[0] for _, v in opening) == pytest.approx(0.08, abs=1e-3)


def test_images_plans_and_texts_are_there(run: Run, read: Read) -> None:
    shots = list(run.log.messages(["/camera/overhead/colour"]))
    images = read.column("/world/camera/overhead/colour", "EncodedImage:blob")
    assert [time for time, _ in images] == [shot.time for shot in shots]
    assert bytes(images[0][1][0])[:2] == b"\xff\xd8"
    ways = [way for _, way in read.column("/world/plan", "LineStrips3D:strips")]
    assert len(ways) == len(run.plans)
    picks = read.column("/events/pick", "TextLog:text")
    assert [text for _, (text,) in picks] == [f"pick: {p.object}: held" for p in run.picks if p.held]


def test_the_recording_says_what_run_it_is(read: Read) -> None:
    ((time, (text,)),) = read.column("/about", "TextDocument:text")
    assert time is None
    assert text.startswith("| | |\n|---|---|\n| mission | one pick |\n| scene | sort_small |\n")
    assert "\n| status | success |" in text


def test_reruns_command_verifies_it(rrd: Path) -> None:
    command = Path(sys.executable).parent / "rerun"
    done = subprocess.run([command, "rrd", "verify", rrd], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 file verified without error." in done.stdout + done.stderr


def test_a_file_that_cannot_be_written_is_one_sentence(run: Run, tmp_path: Path) -> None:
    with pytest.raises(PicktreeError) as raised:
        export(run, "rerun", tmp_path / "nowhere" / "run.rrd")
    assert str(raised.value) == f"{tmp_path}/nowhere/run.rrd cannot be written: no such file or directory"

"""A log and a batch of another machine with markup in every text that they hold."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from picktree.apps.batch import RESULTS_FILE, Batch, BatchPlan, Store
from picktree.apps.batch.tables import JobRows
from picktree.files.file_system import ROOT
from picktree.logs.recording import Recorder
from picktree.world import (
    BlackboardWrite,
    Box,
    Candidate,
    Candidates,
    ImageEntry,
    NodeState,
    ObjectId,
    OtherEvent,
    Plan,
    PlanningScene,
    StageCount,
    Tick,
    Transition,
    Tree,
    TreeNode,
)

from ..batch.test_store import ITEMS, MISSED, SLIP

IMAGE = '<img src=x onerror="globalThis.ran=1">'
MARKUP = f'{IMAGE}<script>globalThis.ran=1</script><a href="javascript:globalThis.ran=1">go</a>'
LINK = "javascript:globalThis.ran=1"


def hostile_log(sample: ModuleType, path: Path) -> None:
    """Record three seconds with a failure. Names, causes, values and lines are markup."""
    fixture = replace(sample.TABLE, id=ObjectId(f"table {MARKUP}"), colour=MARKUP)
    mouth = replace(sample.BIN, id=ObjectId(f"bin {MARKUP}"), colour=LINK)
    both = {MARKUP: MARKUP, LINK: LINK}
    run = replace(
        sample.RUN,
        mission=MARKUP, scene=LINK, robot=MARKUP, parameters=both, physics=both, versions=both, revision=LINK,
    )  # fmt: skip
    scene = PlanningScene([fixture], [mouth])
    item = replace(sample.item(f"item {MARKUP}", Box((0.04, 0.04, 0.04)), MARKUP, 0.4), kind=MARKUP)
    main, leaf = "/Main", f"/Main/{IMAGE}"
    with Recorder(path, run) as recorder:
        recorder.attach("mission.yaml", f"picktree: 1\nkind: mission\nname: '{IMAGE}'\n", "application/yaml")
        recorder.attach(f"{IMAGE}.yaml", MARKUP, "text/html")
        recorder.tree(
            Tree(
                (
                    TreeNode(main, "Sequence", "Main", "", (leaf,)),
                    TreeNode(leaf, IMAGE, IMAGE, main, (), {IMAGE: MARKUP, LINK: LINK}),
                )
            )
        )
        recorder.robot_model(sample.MESHES)
        recorder.fixed([fixture], [mouth])
        for k in range(60):
            now, failed = k * sample.TICK, k == 30
            status, cause = ("FAILURE", f"grasp.{IMAGE}") if failed else ("RUNNING", "")
            if k == 0:
                scene.put(item, MARKUP)
                shot = replace(sample.image(now), camera=f"overhead {IMAGE}")
                recorder.entry(now, ImageEntry(shot, (MARKUP, LINK)))
            if k == 5:
                recorder.log(now, "INFO", MARKUP, IMAGE)
                recorder.log(now, "ERROR", LINK, LINK)
                recorder.entry(now, OtherEvent(MARKUP, leaf, name=IMAGE, extra={MARKUP: LINK}))
                recorder.entry(now, Plan(MARKUP, IMAGE, 1, 0.1, IMAGE, MARKUP, 0.0))
                candidate = Candidate(IMAGE, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.7, MARKUP, LINK)
                recorder.entry(now, Candidates(IMAGE, item.id, (StageCount(MARKUP, 1),), (candidate,)))
            ends = tuple(
                Transition(node, "FAILURE", cause=cause, origin=leaf, message=MARKUP, evidence=both)
                for node in (leaf, main)
            )
            begins = (Transition(main, "RUNNING"), Transition(leaf, "RUNNING", {IMAGE: LINK}, str(item.id)))
            nodes = (
                NodeState(main, "Sequence", status, True, "", cause),
                NodeState(leaf, IMAGE, status, True, MARKUP, cause, both if failed else {}),
            )
            writes = (BlackboardWrite(f"/{IMAGE}", [MARKUP, LINK], main),) if k == 0 else ()
            moved = begins if k in (0, 31) else ends if failed else ()
            recorder.transforms(now, sample.LINKS, scene.objects)
            recorder.belief(now, scene.objects, scene.take_changes())
            recorder.truth(now, scene.objects)
            recorder.tick(now, Tick("RUNNING", leaf, nodes, writes, moved))
        recorder.finish({"status": "FAILURE", "message": MARKUP})


def hostile_batch(folder: Path) -> None:
    """Make a batch of two jobs that are done. Names, causes, colours and messages are markup."""
    plan = BatchPlan(MARKUP, (ROOT / "examples" / "one_pick.yaml",), (0, 1), backend="kinematic")
    with Batch.create(folder, plan):
        pass
    with Store(folder / RESULTS_FILE) as store:
        for job in store.jobs():
            row = replace(
                MISSED, status="failure", message=MARKUP, root_cause=MARKUP, look_at=MARKUP, folder=LINK
            )
            failure = replace(SLIP, node=MARKUP, cause=MARKUP, message=MARKUP, item=MARKUP, handled_by=MARKUP)
            items = tuple(replace(each, kind=MARKUP, form=LINK, colour=MARKUP) for each in ITEMS)
            assert store.record(job.id, JobRows(row, items=items, failures=(failure,)))
    with closing(sqlite3.connect(folder / RESULTS_FILE)) as results, results:
        results.execute("UPDATE jobs SET variant = ?, mission = ?, scene = ?", (MARKUP, LINK, MARKUP))

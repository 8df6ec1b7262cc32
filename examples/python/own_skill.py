"""Use a skill of one's own from its file, alone and in a mission."""

from pathlib import Path

import picktree as pt

probe = pt.nodes.plugin(Path(__file__).parents[1] / "plugins" / "probe.py")
with pt.Cell("sort_small", backend="kinematic") as cell:
    cell.run(pt.nodes.GoTo(pose="home"))
    result = cell.run(probe.Probe(depth="600 mm"))
    print(result)
    assert abs(result.outputs["height"]) < 0.002
mission = pt.Mission(
    pt.Sequence(pt.nodes.GoTo(pose="home"), probe.Probe(depth="600 mm", height="{table}")),
    scene="sort_small",
    folder=Path(__file__).parents[1],
)
print(mission.text)
assert mission.check()

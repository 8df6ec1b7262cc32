"""Compare two grip forces over some seeds (here one: it is an example)."""

from pathlib import Path

import picktree as pt

mission = pt.load(Path(__file__).parents[1] / "one_pick.yaml")
batch = pt.batch(
    mission, seeds=range(1), settings={"Grasp.force": [10, 30]}, backend="kinematic", workers=1, out="forces"
)
print(batch)
print(batch.compare())
print(batch.query("SELECT variant, seed, status, sim_seconds FROM jobs").to_text())
assert batch.variants == ("Grasp.force=10", "Grasp.force=30")

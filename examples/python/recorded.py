"""Record a skill, and ask its log why it failed."""

import picktree as pt
from picktree.analysis import Run

with pt.Cell("sort_small", backend="kinematic", seed=3) as cell:
    result = cell.run(pt.Grasp(object="red_block_1"), log="runs/try")
    assert result.log is not None
    with Run(result.log) as run:
        for failure in run.failures:
            print(f"{failure.time:.2f} s: {failure.cause} at {failure.node}")
        assert [failure.cause for failure in run.failures] == ["world.unknown_object"]

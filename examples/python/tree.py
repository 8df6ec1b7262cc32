"""Build a tree of nodes, run it in a cell, and save it as a mission file."""

import picktree as pt

sort = pt.Sequence(
    pt.Observe(camera="overhead", objects="{items}"),
    pt.ForEach(
        pt.Recover(
            pt.Grasp(object="{item}"),
            pt.Place(object="{item}", into="{item.destination}"),
            when={"grasp.missed": [pt.nodes.SafeRetreat(), pt.Observe(camera="overhead")]},
        ),
        in_="{items}",
        out="{item}",
        most=2,
    ),
    pt.nodes.GoTo(pose="home"),
)
print(sort)
with pt.Cell("sort_small", backend="kinematic", seed=3) as cell:
    assert cell.run(sort)
    assert [item.place for item in cell.belief].count("table") == len(cell.belief) - 2
sort.save("sort_two.yaml", scene="sort_small")
assert pt.load("sort_two.yaml").check()

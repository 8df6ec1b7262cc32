"""Make a mission with a sub-tree that has a typed port; check it, draw it, and run it."""

import picktree as pt

sort_one = pt.Tree(
    "SortOne",
    pt.Recover(
        pt.Grasp(object="{item}"),
        pt.Place(object="{item}", into="{item.destination}"),
        attempts=3,
        otherwise=pt.nodes.SafeRetreat(),
        give_up=pt.nodes.SafeRetreat(hand="open"),
    ),
    ports={"item": "object"},
)
main = pt.Sequence(
    pt.Observe(camera="overhead", objects="{items}"),
    pt.ForEach(pt.SubTree(sort_one, item="{item}"), in_="{items}", out="{item}", on_failure="continue"),
    pt.Fallback(pt.nodes.GoTo(pose="home"), pt.nodes.SafeRetreat()),
)
mission = pt.Mission(main, scene="sort_small", name="sort", goal="misplaced == 0")
print(mission.check())
print(mission.render("sort.svg"))
run = pt.run(mission, seed=3, backend="kinematic")
print(run.explain())
assert run.reached

"""Run single skills: grasp one block, and put it where it belongs."""

import picktree as pt

with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
    cell.run(pt.Observe(camera="overhead"))
    block = cell.belief.find(colour="red", kind="block")
    for skill in (pt.Grasp(object=block.id, force="20 N"), pt.Place(object=block.id, into="red_bin")):
        result = cell.run(skill)
        print(result)
        assert result
    assert cell.belief.find(block.id).place == "red_bin"

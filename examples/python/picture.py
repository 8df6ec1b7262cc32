"""Draw the robot and its belief, from a corner and from above."""

import picktree as pt

with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
    cell.run(pt.Observe(camera="overhead"))
    cell.show(size=(480, 300)).save("corner.png")
    cell.show(view="top", size=(480, 300)).save("top.png")

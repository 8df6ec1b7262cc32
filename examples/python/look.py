"""Look at the table and list what the robot believes to be there."""

import picktree as pt

with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
    cell.run(pt.Observe(camera="overhead"))
    for item in cell.belief:
        x, y, _ = item.pose.position
        print(f"{item.id:14} at {1000 * x:4.0f}, {1000 * y:4.0f} mm, belongs in {item.destination}")

"""Ask for something that cannot be done, and read why."""

import picktree as pt

with pt.Cell("three_bins", backend="kinematic", seed=3) as cell:
    result = cell.run(pt.Grasp(object="red_block_1"))  # nobody has looked yet
    print(result.cause, "|", result.message, "|", result.remedy)
    assert result.cause == "world.unknown_object"
    try:
        cell.run(pt.Grasp(object="red_block_1", force="20 kg"))
    except pt.PicktreeError as error:
        print(error)
    try:
        pt.Grasp(objct="red_block_1")  # pyright: ignore[reportCallIssue]
    except TypeError as error:
        print(error)

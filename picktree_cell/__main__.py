"""Command line: serve a cell file.

python -m picktree_cell CELL.json --at /tmp/cell.sock
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from pathlib import Path
from types import FrameType

from picktree.drivers import protocol

from .cell_description import CellError, read_cell
from .cell_faults import CellFaults, read_faults
from .cell_score import score
from .plant import Plant
from .server import CellServer, serve

MODES = {
    "position": protocol.Capability.POSITION,
    "torque": protocol.Capability.POSITION | protocol.Capability.TORQUE,
}


def main(arguments: list[str] | None = None) -> int:
    """Serve a cell until a signal comes; return the exit code. 2: bad input."""
    parser = argparse.ArgumentParser(
        prog="picktree_cell", description="Serve a robot cell in MuJoCo over picktree's protocol of drivers."
    )
    parser.add_argument("cell", type=Path, help="cell file of `picktree cell`")
    parser.add_argument("--at", default="/tmp/picktree_cell.sock", help="Unix socket, or HOST:PORT")
    parser.add_argument("--seed", type=int, default=0, help="seed of inertias, friction and noise")
    parser.add_argument("--faults", type=Path, help="JSON file with faults of the cell")
    parser.add_argument(
        "--mode", choices=sorted(MODES), default="position", help="commands that the robot takes"
    )
    parser.add_argument("--clients", type=int, default=0, help="end after that number of clients")
    parser.add_argument("--score", type=Path, help="JSON file for the score at the end; else it is printed")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _end)
    try:
        address = protocol.Address.parse(options.at)
        token = os.environ.get(protocol.TOKEN_VARIABLE, "")
        address.require_token(token)
        faults = read_faults(options.faults) if options.faults else CellFaults()
        plant = Plant(read_cell(options.cell), faults, options.seed)
        server = CellServer(plant, options.seed, token, MODES[options.mode])
        try:
            serve(server, address, clients=options.clients)
        except KeyboardInterrupt:
            pass
        finally:
            if address.path and os.path.exists(address.path):
                os.unlink(address.path)
        text = json.dumps(score(plant))
        if options.score:
            options.score.write_text(text + "\n", encoding="utf-8")
        else:
            print(text, flush=True)
    except (CellError, protocol.ProtocolError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())

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
from threading import Thread
from types import FrameType

from picktree.drivers import protocol

from .cell_description import CellError, read_cell
from .cell_faults import CellFaults, read_faults
from .cell_score import score
from .plant import Plant
from .recogniser import GIVES, CellRecogniser, RecogniserFaults, listen, serve_recogniser
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
    parser.add_argument("--perception-at", help="socket at which a recogniser of the items listens, too")
    parser.add_argument("--perception-noise", type=float, default=0.0, help="noise of reported positions, m")
    parser.add_argument(
        "--perception-gives",
        choices=GIVES,
        default="pose",
        help="content of findings; pose: with a mask",
    )
    parser.add_argument(
        "--wrong-labels", type=float, default=0.0, help="share of items under another one's name"
    )
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _end)
    try:
        address = protocol.Address.parse(options.at)
        token = os.environ.get(protocol.TOKEN_VARIABLE, "")
        address.require_token(token)
        faults = read_faults(options.faults) if options.faults else CellFaults()
        plant = Plant(read_cell(options.cell), faults, options.seed)
        server = CellServer(plant, options.seed, token, MODES[options.mode])
        errors = RecogniserFaults(options.perception_noise, options.wrong_labels)
        addresses = [address]
        if options.perception_at:
            recogniser = CellRecogniser(
                plant, errors, options.seed, server.lock, token, options.perception_gives
            )
            addresses.append(_recognise(recogniser, options.perception_at, token))
        try:
            serve(server, address, clients=options.clients)
        except KeyboardInterrupt:
            pass
        finally:
            for each in addresses:
                if each.path and os.path.exists(each.path):
                    os.unlink(each.path)
        text = json.dumps(score(plant))
        if options.score:
            options.score.write_text(text + "\n", encoding="utf-8")
        else:
            print(text, flush=True)
    except (CellError, protocol.ProtocolError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _recognise(recogniser: CellRecogniser, at: str, token: str) -> protocol.Address:
    """Let a recogniser serve in a thread of its own. Raises CellError and ProtocolError."""
    address = protocol.Address.parse(at)
    address.require_token(token)
    listener = listen(address)
    Thread(target=serve_recogniser, args=(recogniser, listener), daemon=True).start()
    return address


def _end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())

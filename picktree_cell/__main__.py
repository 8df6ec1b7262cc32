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

from .cell_description import GIVES, NO_GL, CellError, read_cell
from .cell_faults import CellFaults, read_faults

MODES = {
    "position": protocol.Capability.POSITION,
    "torque": protocol.Capability.POSITION | protocol.Capability.TORQUE,
}


def main(arguments: list[str] | None = None) -> int:
    """Serve a cell until a signal comes; return the exit code. 2: bad input."""
    options = _options().parse_args(arguments)
    signal.signal(signal.SIGTERM, _end)
    try:
        _serve(options)
    except (CellError, protocol.ProtocolError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="picktree_cell", description="Serve a robot cell in MuJoCo over picktree's protocol of drivers."
    )
    add = parser.add_argument
    add("cell", type=Path, help="cell file of `picktree cell`")
    add("--at", default="/tmp/picktree_cell.sock", help="Unix socket, or HOST:PORT")
    add("--seed", type=int, default=0, help="seed of inertias, friction and noise")
    add("--faults", type=Path, help="JSON file with faults of the cell")
    add("--mode", choices=sorted(MODES), default="position", help="commands that the robot takes")
    add("--model", type=Path, help="MJCF file of the robot, in place of the cell file's URDF")
    add(
        "--rename",
        type=_rename,
        action="append",
        default=[],
        metavar="OLD=NEW",
        help="beginning of the cell file's joints and links, and what --model has instead; repeatable",
    )
    add("--camera", choices=("rays", "gl"), default="rays", help="gl: by OpenGL; see MUJOCO_GL of MuJoCo")
    add("--clients", type=int, default=0, help="end after that number of clients")
    add("--film", type=Path, help="film of the run, .mp4 or .gif; needs PyAV")
    add("--score", type=Path, help="JSON file for the score at the end; else it is printed")
    add("--observe-at", help="socket at which clients read the robot beside the one that moves it")
    add("--perception-at", help="socket at which a recogniser of the items listens, too")
    add("--perception-noise", type=float, default=0.0, help="noise of reported positions, m")
    add("--perception-gives", choices=GIVES, default="pose", help="content of findings; pose: with a mask")
    add("--wrong-labels", type=float, default=0.0, help="share of items under another one's name")
    return parser


def _serve(options: argparse.Namespace) -> None:
    """Serve the cell. Raises CellError and ProtocolError for bad input."""
    if options.camera == "gl":
        _choose_gl()
    # MuJoCo chooses its graphics library when it is imported.
    from .cell_score import score
    from .film import Film
    from .gl_camera import GlCamera
    from .plant import Plant
    from .ray_camera import RayCamera
    from .recogniser import CellRecogniser, RecogniserFaults, listen, serve_recogniser
    from .robot_model import MakersModel
    from .server import CellServer, serve

    address = protocol.Address.parse(options.at)
    token = os.environ.get(protocol.TOKEN_VARIABLE, "")
    address.require_token(token)
    faults = read_faults(options.faults) if options.faults else CellFaults()
    if options.rename and not options.model:
        raise CellError("--rename is for the names of --model; give its file, too")
    makers = MakersModel(options.model, tuple(options.rename)) if options.model else None
    plant = Plant(read_cell(options.cell), faults, options.seed, makers)
    film = Film(options.film, plant) if options.film else None
    watched = film.follow if film else lambda: None
    camera = GlCamera if options.camera == "gl" else RayCamera
    server = CellServer(plant, options.seed, token, MODES[options.mode], watched, camera)
    addresses = [address]
    if options.observe_at:
        at = protocol.Address.parse(options.observe_at)
        at.require_token(token)
        Thread(target=serve, args=(server, listen(at)), kwargs={"moves": False}, daemon=True).start()
        addresses.append(at)
    if options.perception_at:
        at = protocol.Address.parse(options.perception_at)
        at.require_token(token)
        errors = RecogniserFaults(options.perception_noise, options.wrong_labels)
        recogniser = CellRecogniser(plant, errors, options.seed, server.lock, token, options.perception_gives)
        Thread(target=serve_recogniser, args=(recogniser, listen(at)), daemon=True).start()
        addresses.append(at)
    try:
        listener = listen(address)
        print(f"ready at {address}", flush=True)
        serve(server, listener, clients=options.clients)
    except KeyboardInterrupt:
        pass
    finally:
        if film:
            film.close()
        for each in addresses:
            if each.path and os.path.exists(each.path):
                os.unlink(each.path)
    text = json.dumps(score(plant))
    if options.score:
        options.score.write_text(text + "\n", encoding="utf-8")
    else:
        print(text, flush=True)


def _choose_gl() -> None:
    """Import MuJoCo with a graphics library that needs no display. Raises CellError where there is none."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco  # noqa: F401 # pyright: ignore[reportUnusedImport]
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise CellError(NO_GL.format(os.environ["MUJOCO_GL"], error)) from None


def _rename(text: str) -> tuple[str, str]:
    old, found, new = text.partition("=")
    if not old or not found:
        raise argparse.ArgumentTypeError(f"{text!r} is no OLD=NEW, as panda_=fr3_")
    return old, new


def _end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())

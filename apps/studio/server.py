"""Server of the studio: the page, the files that it may show, its slices, and the WebSocket of calls."""

from __future__ import annotations

import contextlib
import gc
import logging
import mimetypes
import socket
from collections.abc import AsyncGenerator, Callable, Mapping
from pathlib import Path
from typing import Final

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from picktree.authoring import svg_drawing
from picktree.files import PicktreeError

from .batch_slice import BatchSlice
from .calls import Registry, Viewer
from .folder_slice import FolderSlice
from .jobs import Jobs
from .live_slice import LiveSlice
from .mission_slice import MissionSlice
from .run_slice import RunSlice
from .scene_slice import SceneSlice
from .security import MAX_MESSAGE, SANDBOXED, Guard
from .slice import Slice, Studio
from .workspace import Workspace

SLICES: Final[tuple[Callable[[Studio], Slice], ...]] = (
    FolderSlice,
    MissionSlice,
    SceneSlice,
    RunSlice,
    LiveSlice,
    BatchSlice,
)
HOST: Final = "127.0.0.1"
FIRST_PORT: Final = 8420
"""Preferred port, so that a page finds a restarted server."""
_PORTS_TRIED: Final = 20
MAX_VIEWERS: Final = 32
"""Number of pages that may be connected at once."""
PAGE_FOLDER: Final = Path(__file__).parent / "page"
SHOWN_SUFFIXES: Final = frozenset({".gif", ".html", ".mp4", ".png", ".svg"})
"""Suffixes of files below the folder that the page may show."""


def create_app(workspace: Workspace, port: int) -> ASGIApp:
    """Return the application for a workspace, to be served on a port of this machine."""
    workspace.apply_trust()
    jobs = Jobs(workspace)
    parts = [make(Studio(workspace, jobs)) for make in SLICES]
    registry = Registry((jobs, *parts))
    viewers = set[Viewer]()

    async def conversation(connection: WebSocket) -> None:
        if len(viewers) >= MAX_VIEWERS:
            await connection.close(1013, f"{MAX_VIEWERS} pages are connected")
            return
        viewer = Viewer(connection, registry)
        viewers.add(viewer)
        try:
            await viewer.converse()
        finally:
            viewers.discard(viewer)

    async def shown(request: Request) -> Response:
        return _shown_file(workspace, request.path_params["path"])

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncGenerator[None]:
        await jobs.take_over()
        yield
        for part in parts:
            await part.close()
        await jobs.close()

    routes = [
        Route("/", _page),
        Route("/page/colours.css", _colour_sheet),
        Route("/page/symbols.svg", _symbol_sheet),
        Mount("/page", StaticFiles(directory=PAGE_FOLDER)),
        Route("/files/{path:path}", shown),
        WebSocketRoute("/ws", conversation),
        *(route for part in parts for route in part.routes()),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), workspace.state.token, port)


def _shown_file(workspace: Workspace, path: str) -> Response:
    """Return a picture, a film or a page below the folder. A page has an origin of its own."""
    try:
        place = workspace.resolve(path)
    except PicktreeError as error:
        return PlainTextResponse(f"{error}\n", 404)
    if place.suffix.lower() not in SHOWN_SUFFIXES or not place.is_file():
        return PlainTextResponse("There is no such picture, film or page.\n", 404)
    kind = mimetypes.guess_type(place.name)[0]
    return FileResponse(place, media_type=kind, headers={"content-security-policy": SANDBOXED})


async def _page(_: Request) -> Response:
    return FileResponse(PAGE_FOLDER / "index.html")


async def _colour_sheet(_: Request) -> Response:
    """Return the palette of drawn trees and reports as variables of a style sheet."""

    def variables(colours: Mapping[str, str]) -> str:
        return " ".join(f"--{name}: {value};" for name, value in colours.items())

    text = (
        f":root {{ color-scheme: light; {variables(svg_drawing.LIGHT_COLOURS)} }}\n"
        f':root[data-theme="dark"] {{ color-scheme: dark; {variables(svg_drawing.DARK_COLOURS)} }}\n'
    )
    return Response(text, media_type="text/css")


async def _symbol_sheet(_: Request) -> Response:
    """Return the symbols of nodes in drawn trees, for `use` by their names."""
    symbols = svg_drawing.definitions(svg_drawing.ALL_ICONS)
    text = f'<svg xmlns="http://www.w3.org/2000/svg">{symbols}</svg>'
    return Response(text, media_type="image/svg+xml")


def listen(port: int | None) -> socket.socket:
    """Return a socket on the loopback address; without a port the first that is free, from 8420 on.

    Raises PicktreeError when the port is taken.
    """
    if port is None:
        for candidate in range(FIRST_PORT, FIRST_PORT + _PORTS_TRIED):
            with contextlib.suppress(PicktreeError):
                return listen(candidate)
        return listen(0)
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((HOST, port))
        found.listen(64)
    except OSError as error:
        found.close()
        reason = (error.strerror or str(error)).lower()
        raise PicktreeError(f"port {port} cannot be used: {reason}; --port names another") from None
    return found


def link(workspace: Workspace, listening: socket.socket) -> str:
    """Return the address with which the page is opened."""
    return f"http://{HOST}:{listening.getsockname()[1]}/?token={workspace.state.token}"


def make_server(workspace: Workspace, listening: socket.socket) -> uvicorn.Server:
    """Return the server for a socket of `listen`; it is run with that socket."""
    config = uvicorn.Config(
        create_app(workspace, int(listening.getsockname()[1])),
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE,
        ws_per_message_deflate=False,  # on the loopback address it costs more than it saves
        timeout_graceful_shutdown=3,
    )
    return uvicorn.Server(config)


def serve(folder: Path, port: int | None, ready: Callable[[str], None]) -> None:
    """Serve a folder until Ctrl-C. `ready` gets the link when the port is taken.

    Raises PicktreeError for an invalid folder, or when the port is taken by another program.
    """
    workspace = Workspace(folder)
    with listen(port) as listening:
        logging.basicConfig(format="%(name)s: %(message)s")
        server = make_server(workspace, listening)
        # What is loaded by now stays: collections of garbage, which would hold up answers, pass it over.
        gc.collect()
        gc.freeze()
        ready(link(workspace, listening))
        server.run(sockets=[listening])

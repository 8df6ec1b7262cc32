"""Calls and watches over one WebSocket a viewer.

A slice is a class whose methods are declared with `call` or `watch`. Arguments are the keyword parameters of
the method, checked by their annotations.
"""

from __future__ import annotations

import asyncio
import inspect
import json
import logging
import typing
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, TypeVar, cast

import orjson
from pydantic import BaseModel, ConfigDict, ValidationError, create_model
from starlette.websockets import WebSocket, WebSocketDisconnect

from picktree.files import Diagnostic, FileError, PicktreeError

from .security import MAX_MESSAGE

JsonValue: TypeAlias = dict[str, Any] | list[Any] | str | int | float | bool | None

MAX_RUNNING: Final = 64
"""Number of calls and watches that one viewer may have at once."""
_LOG: Final = logging.getLogger("picktree.apps.studio")
_MARK: Final = "__picktree_call__"
_F = TypeVar("_F", bound=Callable[..., object])


def call(name: str) -> Callable[[_F], _F]:
    """Declare an async method as a call: it returns its result, or raises PicktreeError."""
    return _declare(name, watch=False)


def watch(name: str) -> Callable[[_F], _F]:
    """Declare an async generator method as a watch: each value is an event."""
    return _declare(name, watch=True)


def _declare(name: str, *, watch: bool) -> Callable[[_F], _F]:
    def declared(method: _F) -> _F:
        setattr(method, _MARK, (name, watch))
        return method

    return declared


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Method that a viewer may call by its name."""

    method: Callable[..., Awaitable[object] | AsyncIterator[object]]
    arguments: type[BaseModel]
    is_watch: bool


class Registry:
    """Calls and watches of all slices, by name."""

    def __init__(self, slices: Iterable[object]) -> None:
        self._endpoints: dict[str, Endpoint] = {}
        for each in slices:
            for _, method in inspect.getmembers(each, inspect.ismethod):
                name, is_watch = getattr(method, _MARK, ("", False))
                if not name:
                    continue
                if name in self._endpoints:
                    raise ValueError(f"two slices declare {name!r}")
                self._endpoints[name] = Endpoint(method, _arguments(name, method), is_watch)

    def find(self, name: object, *, is_watch: bool) -> Endpoint:
        """Return the endpoint of a name. Raises PicktreeError for an unknown name."""
        found = self._endpoints.get(name) if isinstance(name, str) else None
        if found is None or found.is_watch is not is_watch:
            shown = name if isinstance(name, str) and len(name) < 80 else "?"
            raise PicktreeError(f"there is no {'watch' if is_watch else 'call'} {shown!r}")
        return found


def _arguments(name: str, method: Callable[..., object]) -> type[BaseModel]:
    hints = typing.get_type_hints(method, include_extras=True)
    fields: dict[str, Any] = {}
    for parameter in inspect.signature(method).parameters.values():
        default = ... if parameter.default is inspect.Parameter.empty else parameter.default
        fields[parameter.name] = (hints[parameter.name], default)
    return create_model(name, __config__=ConfigDict(extra="forbid", strict=True), **fields)


def checked(endpoint: Endpoint, arguments: object) -> Mapping[str, Any]:
    """Return the arguments of a call. Raises PicktreeError that names each argument that does not fit."""
    try:
        model = endpoint.arguments.model_validate_json(json.dumps({} if arguments is None else arguments))
    except ValidationError as error:
        parts = (f"{'.'.join(str(part) for part in each['loc'])}: {each['msg']}" for each in error.errors())
        raise PicktreeError("; ".join(parts)) from None
    return {name: getattr(model, name) for name in endpoint.arguments.model_fields}


def error_values(error: PicktreeError) -> dict[str, JsonValue]:
    """Return an error as a client receives it: its message, and the faults of a file one by one."""
    values: dict[str, JsonValue] = {"message": str(error)}
    if isinstance(error, FileError):
        values["faults"] = [fault_values(fault) for fault in error.faults]
    return values


def fault_values(fault: Diagnostic) -> dict[str, JsonValue]:
    """Return a fault of a file as JSON: place, message, advice, code and severity."""
    return {
        "file": fault.mark.file,
        "line": fault.mark.line,
        "column": fault.mark.column,
        "where": fault.where,
        "message": fault.message,
        "advice": fault.hint,
        "code": fault.code,
        "severity": fault.severity,
        "detail": fault.detail,
    }


class Viewer:
    """Conversation with one page over its WebSocket."""

    def __init__(self, socket: WebSocket, registry: Registry) -> None:
        self._socket = socket
        self._registry = registry
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._sending = asyncio.Lock()

    async def converse(self) -> None:
        """Serve calls and watches until the page leaves; then all of its watches are ended."""
        await self._socket.accept()
        try:
            while True:
                await self._take(await self._socket.receive_text())
        except (WebSocketDisconnect, KeyError):  # KeyError: a binary message
            pass
        finally:
            tasks = list(self._tasks.values())
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with suppress(RuntimeError, WebSocketDisconnect):  # it is closed already
                await self._socket.close()

    async def _take(self, text: str) -> None:
        message = _message(text)
        number = message.get("id")
        if not isinstance(number, int):
            await self._send({"id": None, "error": {"message": "a message is an object with an 'id'"}})
            return
        if message.get("unwatch") is True:
            task = self._tasks.get(number)
            if task is not None:
                task.cancel()
            return
        try:
            if number in self._tasks:
                raise PicktreeError(f"the id {number} is in use")
            if len(self._tasks) >= MAX_RUNNING:
                raise PicktreeError(f"{MAX_RUNNING} calls are running; wait for one of them")
            is_watch = "watch" in message
            endpoint = self._registry.find(message.get("watch" if is_watch else "call"), is_watch=is_watch)
            arguments = checked(endpoint, message.get("with"))
        except PicktreeError as error:
            await self._send({"id": number, "error": error_values(error)})
            return
        task = asyncio.create_task(self._serve(number, endpoint, arguments))
        self._tasks[number] = task
        task.add_done_callback(lambda _: self._tasks.pop(number, None))

    async def _serve(self, number: int, endpoint: Endpoint, arguments: Mapping[str, Any]) -> None:
        try:
            if endpoint.is_watch:
                events = cast("AsyncIterator[object]", endpoint.method(**arguments))
                try:
                    async for event in events:
                        await self._send({"id": number, "event": event})
                finally:
                    close = getattr(events, "aclose", None)
                    if close is not None:
                        await close()
                await self._send({"id": number, "end": True})
            else:
                result = await cast("Awaitable[object]", endpoint.method(**arguments))
                await self._send({"id": number, "result": result})
        except PicktreeError as error:
            await self._send({"id": number, "error": error_values(error)})
        except WebSocketDisconnect:
            pass
        except Exception as error:  # noqa: BLE001 - the border to the page; the log has the lines
            _LOG.exception("a call failed")
            name = type(error).__name__
            message = f"internal error ({name}); the terminal of the studio has the lines"
            await self._send({"id": number, "error": {"message": message}})

    async def _send(self, message: Mapping[str, object]) -> None:
        data = orjson.dumps(message, default=str, option=orjson.OPT_NON_STR_KEYS | orjson.OPT_SERIALIZE_NUMPY)
        async with self._sending:
            with suppress(RuntimeError, WebSocketDisconnect):  # the page has left
                await self._socket.send_text(data.decode())


def _message(text: str) -> Mapping[str, object]:
    if len(text) > MAX_MESSAGE:
        return {}
    try:
        found: object = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return cast("Mapping[str, object]", found) if isinstance(found, dict) else {}

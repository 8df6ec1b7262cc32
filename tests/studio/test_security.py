"""Only the studio's own page, with the token, on this machine, gets an answer; and only from its folder."""

from __future__ import annotations

import json
import re
from pathlib import Path
from urllib.parse import urlparse

import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus

from picktree.apps.studio.security import MAX_MESSAGE

from .conftest import Refused, Served


def test_nothing_is_answered_without_the_token(served: Served) -> None:
    host = {"Host": served.headers["Host"]}
    name = f"picktree_studio_{served.port}"
    for cookie in ({}, {"Cookie": f"{name}=wrong"}, {"Cookie": f"{name}="}, {"Cookie": "other=1; \x07="}):
        for path in ("/", "/page/studio.js", "/files/x.png", "/runs/a/report", "/?token=wrong", "/nowhere"):
            status, _, body = served.get(path, {**host, **cookie})
            assert (status, b"needs the link" in body) == (403, True), (path, cookie)


def test_the_link_sets_a_cookie_that_scripts_and_other_sites_do_not_get(served: Served) -> None:
    address = urlparse(served.link)
    status, headers, _ = served.get(f"/?{address.query}", {"Host": served.headers["Host"]})
    assert (status, headers["location"]) == (303, "/")
    cookie, *attributes = headers["set-cookie"].split("; ")
    assert {each.lower() for each in attributes} == {"httponly", "path=/", "samesite=strict"}
    status, headers, body = served.get("/", {"Host": served.headers["Host"], "Cookie": cookie})
    assert (status, b'<div id="root">' in body) == (200, True)
    policy = headers["content-security-policy"]
    assert re.search(r"script-src 'self';", policy) and "frame-ancestors 'none'" in policy
    assert (headers["x-content-type-options"], headers["referrer-policy"]) == ("nosniff", "no-referrer")


@pytest.mark.parametrize(
    "host",
    [
        "evil.example:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "127.0.0.1:{port}\nevil.example",
        "localhost.evil:{port}",
    ],
)
def test_a_name_that_was_rebound_gets_nothing(served: Served, host: str) -> None:
    asked = {**served.headers, "Host": host.format(port=served.port)}
    assert served.get("/", asked)[0] in (400, 421)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}"]
)
def test_a_page_of_another_origin_gets_nothing(served: Served, origin: str) -> None:
    origin = origin.format(port=served.port)
    assert served.get("/", {**served.headers, "Origin": origin})[0] == 403
    with pytest.raises(InvalidStatus) as refused, served.client(Origin=origin):
        pass
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("cookie", ["", "picktree_studio_1=x"])
def test_a_socket_needs_the_token_and_an_origin(served: Served, cookie: str) -> None:
    for headers in ({"Cookie": cookie}, {"Origin": ""}):
        with pytest.raises(InvalidStatus) as refused, served.client(**headers):
            pass
        assert refused.value.response.status_code == 403


def test_a_page_of_the_same_machine_cannot_embed_anything(served: Served) -> None:
    for site in ("same-site", "cross-site"):
        asked = {**served.headers, "Sec-Fetch-Site": site, "Sec-Fetch-Dest": "script"}
        assert served.get("/page/studio.js", asked)[0] == 403
    assert served.get("/page/studio.js", {**served.headers, "Sec-Fetch-Site": "same-origin"})[0] == 200


def test_only_reading_and_no_body(served: Served) -> None:
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert served.get("/", method=method)[0] == 405
    assert served.get("/", body=b"x")[0] == 413
    assert served.get(f"/?a={'x' * 5000}")[0] == 414


ESCAPES = [
    "../secret.png",
    "%2e%2e/secret.png",
    "..%2fsecret.png",
    "/etc/passwd",
    "a/../../secret.png",
    "linked.png",
    "away/secret.png",
]


@pytest.mark.parametrize("path", ESCAPES)
def test_no_path_leads_out_of_the_folder(served: Served, path: str) -> None:
    secret = served.folder.parent / "secret.png"
    secret.write_bytes(b"secret")
    (served.folder / "linked.png").symlink_to(secret)
    (served.folder / "away").symlink_to(served.folder.parent, target_is_directory=True)
    status, _, body = served.get(f"/files/{path}")
    assert (status, body == b"secret") == (404, False)
    with served.client() as client, pytest.raises(Refused, match="is not below the folder"):
        client.call("files.read", path=path.replace("%2e", ".").replace("%2f", "/"))
    assert served.get(f"/runs/{path}/report")[0] == 404


def test_files_that_are_shown_have_an_origin_of_their_own(served: Served) -> None:
    for name in ("page.html", "picture.svg"):
        (served.folder / name).write_text("<script>alert(1)</script>")
        status, headers, _ = served.get(f"/files/{name}")
        assert (status, headers["content-security-policy"].split(";")[0]) == (200, "sandbox allow-scripts")
    (served.folder / "mission.yaml").write_text("picktree: 1\n")
    assert served.get("/files/mission.yaml")[0] == 404
    for path in ("/page/../server.py", "/page/%2e%2e/server.py", "/page/..%2fserver.py"):
        assert served.get(path)[0] == 404


def test_a_message_that_is_too_large_ends_the_conversation_only(served: Served) -> None:
    # While it is sent, or behind it.
    with served.client() as client, pytest.raises(ConnectionClosedError):
        client.socket.send("x" * (MAX_MESSAGE + 1))
        client.socket.recv(10)
    with served.client() as client:
        assert client.call("folder.state")["files"] == []


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("{", "a message is an object with an 'id'"),
        ("[" * 100_000, "a message is an object with an 'id'"),
        ('{"id": 1, "call": "runs.nothing"}', "there is no call 'runs.nothing'"),
        ('{"id": 1, "call": "runs.index"}', "there is no call 'runs.index'"),
        ('{"id": 1, "call": {"a": 1}}', "there is no call '?'"),
        ('{"id": 1, "call": "files.read"}', "path: Field required"),
        ('{"id": 1, "call": "files.read", "with": {"path": 3}}', "path: Input should be a valid string"),
        ('{"id": 1, "call": "files.list", "with": {"x": 3}}', "x: Extra inputs are not permitted"),
        (
            '{"id": 1, "call": "runs.whatif", "with": {"id": "a", "at": -1}}',
            "at: Input should be greater than or equal to 0",
        ),
    ],
)  # fmt: skip
def test_what_is_no_call_is_one_clear_sentence(served: Served, message: str, said: str) -> None:
    with served.client() as client:
        client.socket.send(message)
        answer = json.loads(client.socket.recv(20))
        assert answer["error"]["message"] == said
        assert client.call("files.list") == []


def test_a_page_from_a_hostile_folder_is_not_trusted_by_itself(served: Served, state_home: Path) -> None:
    (served.folder / "state.json").write_text('{"trusted": true}')
    with served.client() as client:
        assert client.call("folder.state")["trusted"] is False
        (served.folder / "wave.py").write_text("open('ran', 'w')\nNODES = ()\n")
        client.call("folder.trust", trusted=True)
    kept = list(state_home.rglob("state.json"))
    assert len(kept) == 1 and kept[0].stat().st_mode & 0o077 == 0

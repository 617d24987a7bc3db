"""Meshes that ask for more than they hold, and connections that say less than they promise."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading

import pytest

from calib.errors import RobotError
from calib.show.preview.meshes import read_mesh
from calib.show.preview.server import PreviewServer


def refused(tmp_path, name, data, words):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(RobotError, match=words) as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.glb", "a.ply"])
def test_files_that_can_declare_more_than_they_hold_are_not_read(tmp_path, name):
    refused(tmp_path, name, b"", f"kind {name[1:]}, expected .stl, .obj, .dae")


def test_text_is_bounded_more_narrowly_than_binary_data(tmp_path):
    refused(tmp_path, "a.obj", b"v 0 0 0\n" * 1_300_000, "10 MB of text")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-be"])
def test_a_document_type_is_refused_in_every_encoding(tmp_path, encoding):
    text = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><COLLADA>&b;</COLLADA>'
    data = text.encode(encoding)
    if encoding == "utf-16-be":
        data = b"\xfe\xff" + data
    refused(tmp_path, "a.dae", data, "document type")


@pytest.fixture
def server(monkeypatch):
    from calib.show.preview import server as module

    monkeypatch.setattr(module._Handler, "timeout", 0.3)
    with PreviewServer("<p>page</p>", answer=lambda q: {"at": q["at"]}) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(server, length, body, *, close=False):
    connection = socket.create_connection(server.server_address, timeout=5)
    line = f"POST /{server.secret}/ask HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    connection.sendall(f"{line}Content-Length: {length}\r\n\r\n".encode() + body)
    if close:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()
        return b""
    answer = b""
    while part := connection.recv(4096):
        answer += part
    connection.close()
    return answer


def answers(server):
    connection = http.client.HTTPConnection(*server.server_address, timeout=5)
    connection.request("POST", f"/{server.secret}/ask", json.dumps({"at": 1}))
    return json.loads(connection.getresponse().read())


def test_a_body_shorter_than_its_length_holds_no_thread(server, capfd):
    before = threading.active_count()
    assert ask(server, 500, b"{") == b""
    for _ in range(100):
        if threading.active_count() <= before:
            break
        threading.Event().wait(0.05)
    assert threading.active_count() <= before
    assert answers(server) == {"at": 1}
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("length", ["²", "-1", "9" * 5000, "1e3", ""])
def test_a_length_that_is_none_is_answered(server, length, capfd):
    assert ask(server, length, b"").startswith(b"HTTP/1.0 404")
    assert answers(server) == {"at": 1}
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("body", [b"[]", b"5", b"{}", b"[" * 5000, b'{"at": NaN}'])
def test_a_question_without_sense_is_answered(server, body, capfd):
    assert ask(server, len(body), body).startswith(b"HTTP/1.0 400")
    assert "Traceback" not in capfd.readouterr().err


def test_a_dropped_connection_is_one_line(server, capfd):
    ask(server, 500, b"{", close=True)
    assert answers(server) == {"at": 1}
    assert "Traceback" not in capfd.readouterr().err

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


def glb(count, **accessor):
    described = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "count": count, **accessor}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    text = json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", 36, 0x004E4942) + struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


def refused(tmp_path, name, data, words):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(RobotError, match=words) as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


def test_a_mesh_that_declares_a_billion_vertices(tmp_path):
    refused(tmp_path, "a.glb", glb(1_000_000_000), "declares")
    refused(tmp_path, "b.glb", glb(1_000_000_000, bufferView=0), "declares")
    refused(tmp_path, "c.glb", glb(-1, bufferView=0), "declares")
    path = tmp_path / "d.glb"
    path.write_bytes(glb(3, bufferView=0))
    assert len(read_mesh(path).faces) == 1
    ply = b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n"
    refused(tmp_path, "e.ply", ply, "declares")


def test_a_node_with_two_parents_multiplies(tmp_path):
    data = glb(3, bufferView=0)
    length = int.from_bytes(data[12:16], "little")
    described = json.loads(data[20 : 20 + length])
    described["nodes"] = [{"children": [1, 1]}, {"mesh": 0}]
    text = json.dumps(described).encode()
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + data[20 + length :]
    refused(tmp_path, "a.glb", struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body, "damaged")


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

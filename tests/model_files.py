"""The parts of a model file, for the tests that read, edit and spoil them."""

import json
import struct


def split(data):
    """The JSON header of a safetensors file and the bytes of its tensors."""
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def join(header, body):
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def described(data):
    return json.loads(split(data)[0]["__metadata__"]["calib"])

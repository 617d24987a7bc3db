"""The model format: every tensor and key is on the page; older ones say train again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hostile.test_model_file import described
from models import log, measured, trained
from safetensors import safe_open
from safetensors.numpy import load as unpack
from safetensors.numpy import save as pack

import calib
from calib.errors import ModelError
from calib.model_file.loading import from_bytes
from calib.model_file.storage import VERSION, to_bytes

PAGE = (Path(__file__).parents[2] / "docs" / "format.md").read_text(encoding="utf-8")

MODELS = {
    "simulated": lambda: trained("two_link", 300, 5),
    "of a log": lambda: measured(150, 5),
    "without a body": lambda: calib.train(log(300, 1e-3), size=6, body="none"),
    "of a growing neural gas": lambda: trained("two_link", 300, 5, map="gng"),
}


@pytest.mark.parametrize("kind", MODELS)
def test_every_tensor_and_every_key_is_on_the_page(kind, tmp_path):
    path = tmp_path / "m.calib"
    MODELS[kind]().save(path)
    with safe_open(path, framework="np") as file:
        names, metadata = set(file.keys()), file.metadata()
    told = set(re.findall(r"`([a-z0-9_.*]+)`", PAGE))
    starred = {name[2:] for name in told if name.startswith("*.")}
    assert {n for n in names if n not in told and n.partition(".")[2] not in starred} == set()
    said = json.loads(metadata["calib"])
    assert set(said) <= told
    assert set(said["about"]) <= told
    for key in ("smooth", "local", "links"):
        assert set(said[key]) <= told


@pytest.mark.parametrize("version", [1, 2, 0, None, "2"])
def test_an_older_format_says_train_again(version):
    data = to_bytes(trained("two_link", 300, 5))
    header = {**described(data), "format": version}
    old = pack(unpack(data), metadata={"calib": json.dumps(header)})
    with pytest.raises(ModelError, match=f"expected {VERSION}.*train the model again"):
        from_bytes(old)

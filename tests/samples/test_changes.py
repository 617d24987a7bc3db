"""Changes are read as typed, or refused with the choices."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import CalibError, OptionError
from calib.samples.simulation import Change, parse_change, parse_changes

JOINT = ("length", "offset", "gear", "noise", "backlash", "lock")
SENSOR = ("mirror", "scale", "rotate", "shift", "outliers")


@pytest.mark.parametrize(
    ("text", "part", "what", "values", "relative"),
    [
        ("elbow.length=+20%", "elbow", "length", (1.2,), True),
        ("elbow.length=0.3", "elbow", "length", (0.3,), False),
        ("elbow.offset=-0.05", "elbow", "offset", (-0.05,), False),
        ("elbow.gear=1.02", "elbow", "gear", (1.02,), False),
        ("elbow.lock=1.0", "elbow", "lock", (1.0,), False),
        ("elbow.backlash=1e-2", "elbow", "backlash", (0.01,), False),
        ("tip.offset=0.01,-0.02", "tip", "offset", (0.01, -0.02), False),
        ("sensor.shift=0.03,-0.02", "sensor", "shift", (0.03, -0.02), False),
        ("sensor.scale=1.05", "sensor", "scale", (1.05,), False),
        ("sensor.scale=+5%", "sensor", "scale", (1.05,), True),
        ("sensor.mirror=x", "sensor", "mirror", (-1.0, 1.0), False),
        ("sensor.outliers=5%", "sensor", "outliers", (0.05,), False),
        ("left.arm.elbow.lock=1.5", "left.arm.elbow", "lock", (1.5,), False),
        ("a=b.lock=1", "a=b", "lock", (1.0,), False),
        (" Ellbögen 肘.offset = 0.1 ", "Ellbögen 肘", "offset", (0.1,), False),
    ],
)
def test_read_as_typed(text, part, what, values, relative):
    change = parse_change(text)
    assert change == Change(part, what, pytest.approx(values), relative, text.strip())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "WHO.WHAT=VALUE"),
        (".length=3", "WHO.WHAT=VALUE"),
        ("elbow.colour=3", r"length\|offset\|gear\|noise\|backlash\|lock"),
        ("sensor.colour=3", r"mirror\|scale\|rotate\|shift\|outliers"),
        ("tip.length=x", "tip.offset"),
        ("tip.size=1", "tip.offset"),
        ("elbow.length=20%", r"\+20% or 0.3"),
        ("elbow.length=-100%", "above zero"),
        ("elbow.offset=5%", "0.05"),
        ("elbow.gear=0", "lock"),
        ("elbow.noise=-1", "negative"),
        ("sensor.shift=1", "0.03,-0.02"),
        ("sensor.mirror=z", "x or y"),
        ("sensor.outliers=1", "below 1"),
        ("tip.offset=1,inf", "0.01,0.02"),
    ],
)
def test_refused_with_what_was_expected(text, expected):
    with pytest.raises(OptionError, match=expected) as caught:
        parse_change(text)
    assert "\n" not in str(caught.value)
    assert repr(text) in str(caught.value)


def test_degrees_are_for_joints_alone_and_the_text_is_in_rad_then():
    change = parse_change("elbow.lock=90", degrees=["elbow"])
    assert change.values[0] == math.radians(90)
    assert parse_change(change.text) == change
    assert parse_change("sensor.rotate=0.14", degrees=["elbow"]).values == (0.14,)
    assert parse_changes(["slide.lock=90"], degrees=["elbow"])[0].values == (90,)
    assert parse_change("elbow.gear=1.02", degrees=["elbow"]).values == (1.02,)


def test_the_same_thing_changed_twice_is_refused():
    with pytest.raises(OptionError, match=r"a\.lock=2 comes after a.lock=1"):
        parse_changes(["a.lock=1", "b.lock=1", "a.lock=2"])
    assert [c.part for c in parse_changes(["a.lock=1", "b.lock=1"])] == ["a", "b"]
    assert len(parse_changes("a.lock=1")) == 1


@given(st.text() | st.builds("{}.{}={}".format, st.text(), st.sampled_from(SENSOR), st.text()))
def test_any_text_is_a_change_or_a_one_line_error(text):
    error = ""
    try:
        assert parse_change(text).what in JOINT + SENSOR
    except CalibError as caught:
        error = str(caught)
    assert len(error.splitlines()) <= 1

"""Members: what may have changed between a belief and a log, and by how much."""

from __future__ import annotations

import numpy as np
from beliefs import body, exact_body

from calib.change.members import as_built, drift, freedom, members_of


def test_members_go_from_nothing_to_everything_and_respect_what_is_known():
    every = members_of(body().structure)
    assert every[0].groups == ()
    assert len({m.name for m in every}) == len(every)
    sensor = members_of(body().structure, "sensor")
    assert all(g.startswith("view.") or g == "lens" for m in sensor for g in m.groups)
    arm = members_of(body().structure, "joints")
    assert not any(g.startswith("view.") or g == "lens" for m in arm for g in m.groups)
    assert {m.name for m in sensor} | {m.name for m in arm} <= {m.name for m in every}


def test_the_first_joints_offset_is_the_frames_unless_the_arm_alone_has_changed():
    groups = body().structure.groups
    first, second = groups["offset"]
    offset = next(m for m in members_of(body().structure) if m.groups == ("offset",))
    assert freedom(body(), offset)[first] == 0.0
    assert freedom(body(), offset)[second] > 0.0
    assert freedom(body(), offset, "joints")[first] > 0.0
    # nothing of the sensor creeps
    for name, indices in groups.items():
        if name.startswith("view.") or name == "lens":
            assert not drift(body())[indices].any()


def test_an_exact_simulation_is_an_arm_as_it_is_built():
    built = as_built(exact_body())
    sd = built.deviations
    groups = built.structure.groups
    np.testing.assert_allclose(sd[groups["length"]], 1e-3)
    np.testing.assert_allclose(sd[groups["offset"][1:]], np.radians(0.1))
    assert sd[groups["offset"][0]] == 0.0
    np.testing.assert_array_equal(built.beta, exact_body().beta)
    assert as_built(body()) is body()

"""The URDF that is written is the fitted geometry, in the plane and in space, and no more."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from chains import FOLLOWED, MIXED, chain_urdf, turning
from models import arm, babbled, bare, in_pixels, in_space, lengths, log_of, model, no_arm
from reference import pinocchio_pose, random_joints
from scipy.spatial.transform import Rotation

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.spatial import structure_of
from calib.show.deviations import deviations_of
from calib.use.geometry_fit import fit_geometry
from calib.use.urdf import corrected_urdf, gap_to_yourdfpy

ARMS = {
    "six_axis": calib.load_arm("six_axis"),
    "spatial_three": calib.load_arm("spatial_three"),
    "mixed": arm_from_urdf(MIXED),
    "followed": arm_from_urdf(FOLLOWED),
    "locked": arm_from_urdf(MIXED, lock={"lift": 0.4}),
}
CHANGES = [
    ("shoulder.length=+5%", "elbow.length=-3%"),
    ("shoulder.offset=0.03", "elbow.offset=-0.02"),
    ("tip.offset=0.01,0.02", "elbow.offset=0.02"),
]


@pytest.fixture
def written(run, tmp_path):
    """Write the URDF of a model by the command; return how it ended, and the file."""

    def write(trained, words=""):
        trained.save(tmp_path / "m.calib")
        return run(f"urdf {tmp_path}/m.calib -o {tmp_path}/new.urdf {words}"), tmp_path / "new.urdf"

    return write


@pytest.mark.parametrize("changes", CHANGES)
def test_kinematics_of_the_changed_planar_arm(written, changes):
    samples = babbled(*changes, n=100, noise=0.0)
    _, path = written(calib.adapt(model(), samples, cause="joints").model)
    q = random_joints(arm(), 200)
    assert np.abs(calib.load_arm(path).forward(q) - samples.simulation.exact(q)).max() < 1e-5
    assert np.abs(arm().forward(q) - samples.simulation.exact(q)).max() > 5e-3


def no_chain():
    """Another arm's log once gave an elbow offset of 6,844 degrees and 277 mm rms, exit 0."""
    return calib.train(replace(no_arm(400), arm=arm()), size=12)


def another_arm():
    trained = in_space()
    return replace(trained, rows=replace(trained.rows, x=trained.rows.x[::-1] * [1, 1, -1]))


@pytest.mark.parametrize("made", [no_chain, another_arm])
def test_what_geometry_does_not_explain_is_not_written(written, tmp_path, made):
    (tmp_path / "new.urdf").write_text("old")
    done, path = written(made(), "--json")
    assert done.code == 3
    assert done.document["urdf"] is None
    assert path.read_text() == "old"
    assert "% of the reach" in done.err
    assert "mesh" not in done.err


@pytest.mark.parametrize("source", ARMS)
def test_pinocchio_and_yourdfpy_read_the_fitted_geometry(source):
    """With every parameter of the chain off; the probe is at the tip."""
    arm = ARMS[source]
    structure, rng = structure_of(arm, "base"), np.random.default_rng(1)
    beta, q = structure.neutral(), random_joints(arm, 20)
    for group in ("placement", "offset"):
        beta[structure.groups[group]] = rng.normal(0, 0.05, len(structure.groups[group]))
    geometry = replace(fit_geometry(in_space()), arm=arm, structure=structure, beta=beta)
    points, turns = structure.pose(q, beta)
    text = corrected_urdf(geometry)
    assert gap_to_yourdfpy(text, arm.tip) < 1e-9
    again = arm_from_urdf(text, arm.joint_names, arm.tip, lock=arm.locked)
    if source == "followed":  # Pinocchio alone does not know what follows what
        places, matrices = again.chain.poses(q)
    else:
        places, matrices, _ = pinocchio_pose(again, q)
    np.testing.assert_allclose(places, points, atol=1e-9)
    np.testing.assert_allclose(matrices, turns, atol=1e-9)


def test_a_fit_beats_the_drawing_and_holds_the_first_joint_and_pixels_tell_offsets(written):
    trained = in_space()
    geometry = fit_geometry(trained)
    assert geometry.frame_is_free
    assert geometry.residual < 0.5 * geometry.nominal_residual
    assert not geometry.beta[geometry.structure.shifts[0]].any()
    assert geometry.origins[1][0].interval.all()
    done, path = written(trained, "--json")
    assert done.code == 0
    assert done.document["places"]["shoulder_pan"]["shift"]["interval"][0] == 0.0
    assert done.document["residual"] == pytest.approx(geometry.residual)
    assert "sensed point, not written" in written(trained)[0].out
    lines = zip(trained.about.urdf.splitlines(), path.read_text().splitlines(), strict=True)
    assert {"<origin" in new for old, new in lines if old != new} == {True}
    # pixels tell offsets
    geometry = fit_geometry(in_pixels())
    assert geometry.unit == "px"
    assert geometry.residual < 0.6 < 2.0 < geometry.nominal_residual
    offsets = [float(offset.value) for offset in geometry.offsets().values()]
    assert offsets[1:] == pytest.approx([0.03, -0.02], abs=3e-3)


def test_poses_turn_the_wrist_too():
    """Of a log of poses the URDF was fitted to positions alone: the tool was .1 deg off."""
    arm, rng = ARMS["six_axis"], np.random.default_rng(0)
    q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper, (200, 6))
    offsets = np.array([0.0, 0.0, -0.003, 0.0, 0.004, 0.0])
    position, quaternion = arm.pose(q + offsets)
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    mount = Rotation.from_rotvec([0.02, 0.1, -0.05])
    noise = Rotation.from_rotvec(rng.normal(0.0, 2e-4, (200, 3)))
    seen = turn.apply(position) + rng.normal(0.0, 5e-5, position.shape)
    turned = (turn * Rotation.from_quat(quaternion) * mount * noise).as_quat()
    log = log_of(arm, q[:80], seen[:80], orientation=turned[:80])
    corrected = arm_from_urdf(corrected_urdf(fit_geometry(calib.train(log, size=3))))
    truth = Rotation.from_quat(quaternion)
    fitted = Rotation.from_quat(corrected.pose(q)[1])
    # what stands before the base and behind the tip is the sensor's
    base = (fitted * truth.inv()).mean()
    tip = (truth.inv() * base.inv() * fitted).mean()
    left = (base * truth * tip).inv() * fitted
    assert np.degrees(left.magnitude().mean()) < 0.03


def test_a_zero_is_one_number_with_an_interval_that_holds(written, tmp_path, run):
    """`info`, `urdf` and `export` told three: -.2 +- 1.1, -2.63 +- 1.22, and -3.0 was true."""
    rows = bare("six_axis", 100, 1, "elbow.offset=-0.05", noise=1e-4)
    done, _ = written(calib.train(rows, size=4), "--json")
    zero = done.document["offsets"]["elbow"]
    assert abs(zero["value"] + 0.05) < zero["interval"] < 0.02
    motors = {"homing_offset": 0, "range_min": 800, "range_max": 3200}
    (tmp_path / "old.json").write_text(json.dumps(dict.fromkeys(rows.joint_names, motors)))
    words = f"--lerobot {tmp_path}/old.json -o {tmp_path}/new.json --json"
    lerobot = run(f"export {tmp_path}/m.calib {words}").document
    parameters = run(f"info {tmp_path}/m.calib --json").document["body"]["parameters"]
    (entry,) = (part for part in parameters if part["name"] == "elbow.offset")
    told = (zero["value"], zero["interval"])
    assert (lerobot["offsets"]["elbow"], lerobot["intervals"]["elbow"]) == pytest.approx(told)
    assert (entry["value"], entry["high"] - entry["value"]) == pytest.approx(told)
    alone = fit_geometry(calib.train(rows, size=4, free="offsets")).offsets()["elbow"]
    assert abs(alone.value + 0.05) < alone.interval < 0.3 * zero["interval"]


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_drawn_turns_are_no_zeros_and_millimetres_scale_no_lengths(written, tmp_path, run, unit):
    """Zeros were told up to 180 deg off where a drawing's origins are turned."""
    text = chain_urdf(turning(), turning("0 0 -1", '0.25 0 0" rpy="0 0 1.2'))
    drawn, real = arm_from_urdf(text), arm_from_urdf(text.replace("0.25", "0.256"))
    q = random_joints(drawn, 60)
    truth = real.forward(np.add(q, [0.0, 0.05]))
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (60, 2))
    metre = 1000 if unit == "mm" else 1
    log = log_of(drawn, q, metre * (truth + noise), unit=unit)
    before = log_of(drawn, q, metre * (real.forward(q) + noise), unit=unit)
    # a joint whose axis points down was told with the other sign
    (cause,) = calib.check(calib.train(before, size=3), log).causes
    assert cause.value == pytest.approx(0.05, abs=2e-3)
    _, path = written(calib.train(log, size=3))
    (zero, *_) = deviations_of(calib.load(tmp_path / "m.calib"))
    assert (zero.name, zero.value) == ("j2: zero", pytest.approx(0.05, abs=2e-3))
    assert lengths(calib.load_arm(path).forward(q) - truth).max() < 3e-4
    words = run(f"info {tmp_path}/m.calib").out
    assert float(re.search(r"j2: .*?([+-]\d+\.\d+) ±", words)[1]) == pytest.approx(2.86, abs=0.1)
    assert "turns against" not in words


def test_a_joint_that_counts_the_other_way_has_the_zero_of_the_body(written, tmp_path, run):
    """The geometry has the drawing's senses and explains nothing: it told 49 deg for 2.8."""
    drawn = calib.load_arm("three_link")
    q = random_joints(drawn, 80)
    x = drawn.forward(q) + np.random.default_rng(0).normal(0.0, 1e-4, (80, 2))
    logged = q * [1, 1, -1] - [0.0, 0.0, 0.05]
    log = replace(log_of(drawn, logged, x), lower=logged.min(0), upper=logged.max(0))
    done, _ = written(calib.train(log, size=3), "--json")
    assert (done.code, done.document["urdf"]) == (3, None)
    words = run(f"info {tmp_path}/m.calib").out
    told = re.search(r"wrist: .*?([+-]\d+\.\d+) ±.*turns against its log", words)
    assert float(told[1]) == pytest.approx(2.86, abs=0.2)


@pytest.mark.parametrize("order", [1, -1])
def test_a_geometry_is_fitted_to_the_sensor_that_measures_lengths(written, order):
    arm, rng = calib.load_arm("two_link"), np.random.default_rng(0)
    real = arm.with_link_length("elbow", 0.255)
    logs = []
    for name, unit, size in (("tracker", "m", 1.0), ("camera", "px", 800.0)):
        q = random_joints(arm, 60, len(name))
        z = size * (real.forward(q) + rng.normal(0.0, 1e-4, (60, 2)))
        logs.append(log_of(arm, q, z, sensor=name, unit=unit))
    done, path = written(calib.train(logs[::order], size=3))
    assert "fitted to the rows of sensor 'tracker' alone" in done.err
    q = random_joints(arm, 50)
    assert lengths(calib.load_arm(path).forward(q) - real.forward(q)).max() < 5e-4


def test_nothing_differs_from_the_drawing_of_a_simulated_arm():
    """Steps that no row determines cancel: linearised, they left a wrist 48 mm and 34 deg off."""
    simulated = calib.train(calib.babble(ARMS["six_axis"], 300, noise=2e-4), size=4)
    assert max(deviation.effect for deviation in deviations_of(simulated)) < 5e-4


@pytest.mark.parametrize("seed", [1, 2, 7])
def test_waves_of_the_joints_are_in_the_interval_of_a_zero(seed):
    """Waves of 1 mrad, which no URDF holds, were 1.7 to 2.1 intervals of the shoulder's zero."""
    drawing, rng = ARMS["spatial_three"], np.random.default_rng(seed)
    q = rng.uniform(drawing.lower, drawing.upper, (80, 3))
    zeros = rng.normal(0, 3e-3, 3) * (0, 1, 1)
    x = drawing.forward(q + zeros + 1e-3 * np.sin(3 * q + rng.uniform(0, 6, 3)))
    x += 2e-5 * rng.normal(size=x.shape)
    model = calib.train(log_of(drawing, q, x), size=3, view="base")
    lift = fit_geometry(model, geometry_is_drawn=True).offsets()["shoulder_lift"]
    assert abs(lift.value - zeros[1]) < lift.interval < 3e-3


@pytest.mark.parametrize(("size", "seed"), [(20, 2), (40, 1)])
def test_intervals_of_maps_alone_hold_the_lengths_of_the_simulated_arm(size, seed):
    """Errors of maps hang together: 500 nodes tell no more than a few rows."""
    maps = calib.train(calib.babble(arm(), 3000, seed=seed), size=size, seed=seed, body="none")
    for shift in fit_geometry(maps).document()["moved"].values():
        assert (np.abs(shift.value) < shift.interval).all()


def test_a_first_axis_that_stands_elsewhere_in_the_root_frame_is_written(written):
    """A log in the root's frame tells where the first axis is: held as drawn, it left 2 mm."""
    drawn = ARMS["six_axis"]
    head, first, rest = drawn.urdf.partition('<joint name="shoulder_pan"')
    moved = 'xyz="0.001 -0.002 0.12" rpy="0.004 -0.003 0"'
    text = head + first + re.sub(r'xyz="[^"]*" rpy="[^"]*"', moved, rest, count=1)
    real = arm_from_urdf(text, drawn.joint_names, drawn.tip)
    q = random_joints(drawn, 200)
    truth = real.forward(q)
    x = truth + np.random.default_rng(0).normal(0.0, 1e-4, (200, 3))
    done, path = written(calib.train(log_of(drawn, q, x), view="base", size=3))
    assert done.code == 0, done.err
    assert np.abs(drawn.forward(q) - truth).max() > 2e-3
    assert lengths(calib.load_arm(path).forward(q) - truth).max() < 3e-4

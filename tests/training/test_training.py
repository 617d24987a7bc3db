"""Training: figures that it must reach, small logs, options; evaluation, by hand and by truth."""

from dataclasses import replace

import models
import numpy as np
import pytest
from conftest import lengths, refused
from models import bare, draw, log, log_of, measured, of_a_third, papers, trained, two_link
from reference import random_joints
from scipy.spatial.transform import Rotation

import calib

MM = 1e-3
MISFITS = {  # of a log in space: joints, positions, orientations, what the refusal says
    "still": (lambda q, x, r: (q, 0 * x + 0.1, None), "same in every row"),
    "shuffled": (lambda q, x, r: (q, x[::-1], None), "does not explain"),
    "exchanged": (lambda q, x, r: (q[:, ::-1], x, None), "explain|exchanged"),
    "mirrored": (lambda q, x, r: (q, x[:, [1, 0, 2]], None), "does not explain"),
    "turned": (lambda q, x, r: (q, x, r[::-1]), "do not turn as the joints do"),
}
IMPOSSIBLE = [
    ({"size": 0}, "size 0x0: a lattice needs at least 2"),
    ({"size": 100_000}, "10,000,000,000 nodes are more than"),
    ({"size": 7.5}, "expected whole numbers"),
    ({"size": "70x"}, "expected whole numbers"),
    ({"size": (5, 5, 5)}, "5x5x5: expected at most 2 numbers"),
    ({"sensory_size": (5, 5, 5)}, "sensory size 5x5x5: expected at most 2 numbers"),
    ({"seed": -1}, "seed is -1, expected a whole number"),
    ({"map": "vsom"}, "map 'vsom': expected one of som, vdsom"),
    ({"rule": "magic"}, "rule 'magic': expected one of batch, online"),
    ({"epochs": 0}, "epochs 0: at least 1"),
    *(
        ({"sigma": sigma}, "sigma .*: give .START, END. in nodes with START")
        for sigma in [(1.0, 2.0), (np.nan, 1.0), (2, -1), (5,), 3.0, ("wide", 1)]
    ),
    ({"body": "some"}, "body 'some': expected one of auto, none"),
    ({"view": "sideways"}, "view 'sideways': expected one of auto, base, rigid"),
    ({"view": "base"}, "view 'base' needs a measured log and the planar robot"),
]


def mean_error(model, n=3000, seed=50, margin=0.0):
    q = draw(model, n, seed, margin)
    said = model.forward(q)
    known = np.isfinite(said[:, 0])
    assert known.mean() > 0.9
    return float(lengths(said[known] - two_link(q[known])).mean())


def test_the_papers_arm_is_learned_far_below_the_papers_errors_and_noise_is_averaged_out():
    model = papers()
    q = draw(model, 10_000, seed=50)
    gap = lengths(model.forward(q) - two_link(q))
    assert gap.mean() <= 0.002 * MM
    assert gap.max() <= 0.05 * MM
    back = np.degrees(np.abs(model.inverse(two_link(q), near=q) - q))
    assert back.mean() <= 0.002
    assert back.max() <= 0.05
    assert mean_error(papers(1 * MM), 10_000) <= 0.13 * MM


def test_the_papers_own_readout_comes_close_to_the_papers_tables(all_points):
    errors = calib.evaluate(papers()).errors
    for axis, mean, largest in (("x", 1.15, 11.7), ("y", 1.26, 15.0)):
        assert errors["activity"]["forward"][axis]["mean"] <= 1.5 * mean * MM
        assert errors["activity"]["forward"][axis]["max"] <= 2 * largest * MM
    for joint, mean in (("shoulder", 0.31), ("elbow", 0.44)):
        assert np.degrees(errors["activity"]["inverse"][joint]["mean"]) <= 2 * mean


@pytest.mark.parametrize("rows", [10, 30, 300])
def test_maps_of_small_logs_learn_from_what_the_body_predicts(rows):
    model = calib.train(log(rows), size=8)
    assert mean_error(model) < 1e-3 * MM
    # the links know branches and neighbourhoods where no row was
    assert (np.diff(model.links.indptr) > 0).all()
    assert model.about.errors["linear"]["forward"]["distance"]["mean"] < 15 * MM


@pytest.mark.parametrize(("rows", "side"), [(40, 20), (3920, 28)])
def test_without_a_size_a_log_gets_about_five_rows_per_node_and_not_too_few_nodes(rows, side):
    notes = calib.train(log(rows)).about.notes
    assert any(f"{side}x{side} nodes for {rows:,} rows" in note for note in notes)


def test_a_noisy_log_reports_its_error_on_blocks_that_were_held_out():
    about = measured().about
    assert about.source == "log"
    assert about.simulation is None
    printed = about.errors["local"]["forward"]["distance"]["mean"]
    # what a reading differs from the true position, and hardly more
    assert printed == pytest.approx(MM * np.sqrt(np.pi / 2), rel=0.1)
    assert mean_error(measured()) < 0.3 * MM


def test_ripples_of_a_gear_are_learned_by_the_local_models():
    s = calib.babble(calib.load_arm("two_link"), 3000)

    def rippled(q):
        return two_link(q) + 1e-3 * np.sin(30 * q[:, :1])

    model = calib.train(replace(s, x=rippled(s.q), simulation=None, arm=None), size=16)
    assert model.predictor.models.degree >= 1
    q = draw(model, 1000, seed=1)
    assert lengths(model.forward(q) - rippled(q)).mean() < 0.2 * MM
    q = draw(model, 300, seed=2, margin=0.05)
    x = rippled(q)
    assert np.abs(model.forward(model.inverse(x, near=q)) - x).max() < 1e-8


def test_a_log_of_an_arm_has_the_urdf_as_prior_and_one_of_names_has_none():
    rows = log(12, 1 * MM)
    with_robot = calib.train(rows, size=4)
    names = calib.train(replace(rows, arm=None), size=4)
    assert with_robot.body.structure.nominal is not None
    assert names.body.structure.nominal is None
    # a frame that need not be found helps too
    in_base = calib.train(rows, size=4, view="base")
    assert mean_error(in_base) < mean_error(with_robot) < mean_error(names)


def test_both_bounds_hold_where_no_row_was():
    """A log of one half of the elbow's range, asked over the other half."""
    rows = log(400, 1 * MM)
    model = calib.train(rows.take(rows.q[:, 1] < 1.4), size=10)
    asked = log(3000, 1 * MM, seed=9)
    other = asked.take(asked.q[:, 1] >= 1.4)
    assert np.isfinite(model.forward(other.q)).all()
    assert models.accuracy(model, other.q, other.x, "expected_error")[1] >= 0.93
    assert models.accuracy(model, other.q, two_link(other.q))[1] >= 0.93
    assert model.model_error(other.q).max() < 0.1 * model.reach
    # both grow with the distance from the rows
    beside, far = model.model_error([[0.8, 1.3], [0.8, 2.5]])
    assert far > beside


@pytest.mark.parametrize("rule", ["batch", "online"])
@pytest.mark.parametrize("name", ["som", "vdsom:error", "vdsom:rho"])
def test_every_network_and_rule_trains_maps_that_read_out_well(name, rule):
    model = trained("two_link", 1200, 10, map=name, rule=rule)
    assert model.about.options["map"] == name
    assert model.about.options["rule"] == rule
    most = 0.03 if rule == "batch" else 0.07
    q = draw(model, 2000, seed=50)
    assert lengths(model.forward(q, "activity") - two_link(q)).mean() < most


def test_a_simulated_hobby_arm_is_learned_wherever_random_chains_end():
    """From random chains alone the search ended at the mean of all positions, 32 mm off."""
    about = trained("so101", 20_000, 4).about
    assert about.errors["local"]["forward"]["distance"]["max"] < 1e-12
    assert about.bound_holds


@pytest.mark.parametrize("name", ["six_axis", "two_link"])
def test_a_drawing_that_is_trusted_leaves_zeros_and_frame(name):
    arm = calib.load_arm(name)
    rng = np.random.default_rng(0)
    zeros = np.radians(rng.normal(0.0, 1.0, arm.dof))
    zeros[0] = 0.0  # which no free frame tells from its own turn
    q = rng.uniform(arm.lower, arm.upper, (212, arm.dof))
    seen = arm.forward(q + zeros) + 0.3
    noisy = seen + 1e-4 * rng.standard_normal(seen.shape)
    log = log_of(arm, q[:12], noisy[:12])

    def miss(free):
        model = calib.train(log, size=4, free=free)
        error = lengths(model.forward(q[12:]) - seen[12:])
        assert np.mean(error <= model.model_error(q[12:])) >= 0.95
        return error.mean()

    assert miss("offsets") < 0.8 * miss("all")
    no_drawing = replace(log, arm=None)
    refused(calib.OptionError, "trusts the drawing", calib.train, no_drawing, free="offsets")


@pytest.mark.parametrize(("options", "message"), IMPOSSIBLE)
def test_impossible_options_are_refused_in_one_line(options, message):
    samples = calib.babble(calib.load_arm("two_link"), 200)
    refused(calib.OptionError, message, calib.train, samples, **{"size": 5, **options})


def test_too_few_rows_are_refused_and_ten_are_enough():
    words = "poses: 9, in 9 rows: too few to learn from, give at least 10"
    refused(calib.LogError, words, calib.train, log(9), size=4)
    assert calib.train(log(10), size=4).about.samples == 10


def test_a_joint_that_never_moved_is_refused_or_ignored():
    moved = log(200)
    q = np.column_stack([moved.q[:, 0], np.ones(200)])
    model = calib.train(replace(moved, q=q, x=two_link(q), arm=None), size=8)
    along = np.stack([np.linspace(0.1, 1.4, 20), np.ones(20)], axis=1)
    np.testing.assert_allclose(model.forward(along), two_link(along), atol=1e-4)
    assert np.isnan(model.forward([0.5, 2.0])).all()
    # beside the rows the bound tells where the answers end, in batches and one by one
    beside = np.stack([np.full(81, 0.5), 1.0 + np.linspace(-0.05, 0.05, 81)], axis=1)
    bound, x = model.model_error(beside), model.forward(beside)
    error = lengths(x - two_link(beside))
    known = np.isfinite(bound)
    assert 2 < known.sum() < 80
    assert (bound[known] <= 0.1 * model.reach).all()
    assert (error[known] <= bound[known]).all()
    np.testing.assert_array_equal(known, np.isfinite(x).all(axis=1))
    np.testing.assert_allclose([model.forward(q) for q in beside], x, atol=1e-12)
    # derivatives of the sensor are differences: rounding of 5e-13 by what no row tells, 9 sds
    alone = [model.model_error(q) for q in beside]
    np.testing.assert_allclose(alone, bound, rtol=1e-9, atol=1e-11)


def test_maps_that_did_not_unfold_are_refused_in_one_line():
    samples = calib.babble(calib.load_arm("two_link"), 100, seed=0)
    with pytest.raises(calib.OptionError, match=r"map.*`size`"):
        calib.train(samples, size=4, map="som", epochs=3, sigma=(1e9, 1e9))


@pytest.mark.parametrize("case", MISFITS)
def test_rows_that_no_arm_in_space_explains_are_refused_in_one_line(case):
    arm = calib.load_arm("spatial_three")
    q = random_joints(arm, 60, seed=1)
    change, words = MISFITS[case]
    q, x, orientation = change(q, *arm.pose(q))
    refused(calib.LogError, words, calib.train, log_of(arm, q, x, orientation=orientation), size=3)


@pytest.mark.parametrize(("drawn", "words"), [(False, "orientations are not used"), (True, "")])
def test_orientations_of_an_arm_that_nothing_draws_are_told_to_be_of_no_use(drawn, words):
    arm = calib.load_arm("spatial_three")
    q = random_joints(arm, 60, seed=1)
    x, orientation = arm.pose(q)
    log = calib.Samples(q, x, arm.joint_names, arm=arm if drawn else None, orientation=orientation)
    notes = " ".join(calib.train(log, size=3).notes)
    assert words in notes
    assert drawn == ("orientations" not in notes)


@pytest.mark.parametrize(("n", "noise", "most"), [(60, 1e-4, 3e-4), (200, 0.0, 1e-12)])
def test_without_a_drawing_a_chain_in_space_is_found(n, noise, most):
    arm = calib.load_arm("spatial_three")
    rows = replace(calib.babble(arm, n, noise=noise), arm=None)
    model = calib.train(rows if noise == 0.0 else replace(rows, simulation=None), size=3)
    q = random_joints(arm, 100, seed=1)
    error = lengths(model.forward(q) - arm.forward(q))
    assert error.mean() < most
    assert noise == 0.0 or np.mean(error <= model.model_error(q)) > 0.9


def test_rows_held_out_of_few_without_a_drawing_do_not_contradict_a_bound_that_holds():
    # what is left without a block of 24 rows knows such an arm worse than all of them do
    rows, exact, q = of_a_third(24, 1e-3, seed=1)
    model = calib.train(rows, size=4)
    assert models.accuracy(model, q, exact(q), "expected_error")[1] > 0.9
    assert model.about.bound_holds
    assert model.about.within["covered"] > 0.9


@pytest.mark.parametrize(("size", "share"), [(4, 0.0), (9, 0.86)])
def test_rows_without_an_answer_do_not_speak_against_the_bound(size, share):
    """16 nodes know no place to a tenth of the reach, yet their bound covers what it should."""
    model = calib.train(log(30 * size, 0.0), size=size, body="none")
    within = model.about.within
    assert within.get("answered", 1.0) == pytest.approx(share, abs=0.05)
    assert within.get("covered", 1.0) > 0.85  # of fewer than ten answers there is no share
    assert model.about.bound_holds == (share > 0.5)


@pytest.mark.parametrize("body", ["auto", "none"])
def test_outliers_of_a_simulated_sensor_are_left_out_as_those_of_a_log_are(body):
    """They made the arm 16 mm wrong; the same rows read from a file .25 mm."""
    arm = calib.load_arm("two_link")
    samples = calib.babble(arm, 600, seed=0, noise=2e-4, changes=["sensor.outliers=10%"])
    model = calib.train(samples, size=8, body=body)
    assert 45 <= model.about.left_out <= 60
    assert model.about.bound_holds
    errors = model.about.errors[model.default_readout]
    assert errors["forward"]["distance"]["mean"] < (2e-4 if body == "auto" else 0.02)


def test_a_slide_that_nobody_named_is_told():
    arms = (calib.load_arm(robot) for robot in ("polar", "two_link"))
    polar, turning = (calib.babble(arm, 300, noise=0.1 * MM) for arm in arms)
    nameless = calib.Samples(polar.q, polar.x, polar.joint_names)
    named = replace(nameless, revolute=polar.revolute)
    for rows in (nameless, named, calib.Samples(turning.q, turning.x, turning.joint_names)):
        notes = " ".join(calib.train(rows, size=10).about.notes)
        assert ("if a joint slides, name it in `prismatic`" in notes) is (rows is nameless)


def test_a_simulated_model_repeats_the_errors_of_its_training():
    for model in (trained("two_link"), papers(1e-3)):
        evaluation = calib.evaluate(model)
        assert (evaluation.rows, evaluation.left_out) == (1000, 0)
        assert evaluation.source == "fresh exact samples"
        assert evaluation.within == pytest.approx(model.about.within, rel=1e-6)
        for readout, ways in evaluation.errors.items():
            for way, columns in ways.items():
                for column, figures in columns.items():
                    expected = model.about.errors[readout][way][column]
                    assert figures == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_another_log_is_compared_row_by_row():
    model, fresh = trained("two_link"), log(400, 1e-3, seed=5)
    evaluation = calib.evaluate(model, fresh)
    missed = model.forward(fresh.q) - fresh.x
    back = np.abs(model.inverse(fresh.x, near=fresh.q, nearest=True) - fresh.q)
    for readout, column, error in (
        ("forward", "distance", lengths(missed)),
        ("forward", "y", np.abs(missed[:, 1])),
        ("inverse", "elbow", back[:, 1]),
    ):
        expected = {"mean": error.mean(), "max": error.max(), "p99": np.quantile(error, 0.99)}
        assert evaluation.errors["local"][readout][column] == pytest.approx(expected, rel=1e-5)
    assert (evaluation.rows, evaluation.left_out) == (400, 0)
    assert evaluation.source == "measured rows of the log"
    learned = measured()
    _, covered = models.accuracy(learned, fresh.q, fresh.x, "expected_error")
    assert calib.evaluate(learned, fresh).within["covered"] == covered
    assert calib.evaluate(learned, replace(fresh, left_out=3)).left_out == 3  # by who read it
    of_few = calib.evaluate(learned, log(9, 2e-3, seed=3))  # no share of fewer than ten
    assert (of_few.within.keys(), of_few.bound_holds) == ({"p95"}, None)


def test_errors_of_orientations_are_what_a_tracker_adds():
    rows = bare("spatial_three", 120, 0, noise=0.0)
    noise = Rotation.from_rotvec(np.random.default_rng(0).normal(0, 2e-3, (120, 3)))
    orientation = (Rotation.from_quat(rows.arm.pose(rows.q)[1]) * noise).as_quat()
    rows = replace(rows, orientation=orientation)
    model = calib.train(rows.take(slice(0, 80)), size=3)
    evaluation = calib.evaluate(model, rows.take(slice(80, 120)))
    told = evaluation.errors["local"]["forward"]["orientation"]["mean"]
    assert told == pytest.approx(noise[80:].magnitude().mean(), rel=0.1)


def test_rows_outside_of_what_was_learned_and_repeated_ones_are_counted():
    rows = measured().rows
    some = replace(rows, q=rows.q[::2], x=rows.x[::2], held_out=rows.held_out[::2])
    assert calib.evaluate(replace(measured(), rows=some), log(1200, 1e-3)).learned == 1200
    repeated = log(8, 1e-3, seed=5).take(np.repeat(np.arange(8), 15))
    evaluation = calib.evaluate(papers(1e-3), repeated)
    assert (evaluation.rows, evaluation.notes) == (8, ("112 repeated rows count once",))
    arm = calib.load_arm("two_link")
    narrow = calib.train(calib.babble(arm.with_range({"elbow": (1.0, 2.0)}), 1000), size=10)
    fresh = log(500, seed=5)
    within = np.sum((fresh.q[:, 1] >= 1.0) & (fresh.q[:, 1] <= 2.0))
    evaluation = calib.evaluate(narrow, fresh)
    assert (evaluation.rows, evaluation.left_out) == (within, 500 - within)


def test_a_log_of_other_joints_is_refused_and_one_in_another_order_is_the_same_log():
    s, model = log(50), trained("two_link")
    other = replace(s, joint_names=("hip", "knee"), arm=None)
    words = "log's joints are hip, knee, the model's are shoulder"
    refused(calib.LogError, words, calib.evaluate, model, other)
    joints = (s.joint_names, s.lower, s.upper, s.revolute)
    turned = calib.Samples(s.q[:, ::-1], s.x, *(values[::-1] for values in joints))
    assert calib.evaluate(model, turned).errors == calib.evaluate(model, s).errors
    assert calib.check(model, turned).score == calib.check(model, s).score


def test_a_frame_that_moved_is_told_and_can_be_found_anew():
    model = calib.train(bare("two_link", 200, 1, noise=1e-4), size=8)
    fresh = bare("two_link", 200, 2, noise=1e-4)
    rotation = Rotation.from_rotvec([0.0, 0.0, 0.1]).as_matrix()[:2, :2]
    moved = replace(fresh, x=fresh.x @ rotation.T + [0.02, -0.01])
    kept, free = calib.evaluate(model, moved), calib.evaluate(model, moved, frame="free")
    assert kept.errors["local"]["forward"]["distance"]["mean"] > 0.01
    assert free.errors["local"]["forward"]["distance"]["mean"] < 3e-4
    assert any("drifted: the sensor's frame moved" in note for note in kept.notes)
    assert kept.verdict.changed
    assert any("found anew" in note for note in free.notes)
    assert not any("frame" in note for note in calib.evaluate(model, fresh).notes)

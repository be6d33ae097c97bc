"""Which settings fit a labelled recording: honest halves, whole files, one sentence of error."""

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import binomtest

from contactfusion.errors import ConfigurationError
from contactfusion.readings import Reading
from contactfusion.tune.fusion import (
    LADDER,
    Tuned,
    fields_to_vary,
    fingerprint,
    kept_in,
    override,
    tune_fusion,
)
from contactfusion.tune.report import (
    advice,
    as_csv,
    as_json,
    set_line,
    table,
    write_picture,
    write_tuning,
)
from contactfusion.tune.score import (
    Half,
    Label,
    Rate,
    halving,
    read_labels,
    require_within,
    scored,
    wilson,
)
from contactfusion.yaml_files import with_overrides
from tests.clouds import HERE, REGULAR, THERE, centres, cloud
from tests.explained import stepped
from tests.fusion_toys import CONFIG, makes, offer_eye, seen

TIMES = [(2.0, 4.0), (6.0, 8.0), (12.0, 14.0), (16.0, 18.0)]
VARY = ("integrator.threshold=0.1,0.4",)


@pytest.fixture(autouse=True)
def eye(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_eye(monkeypatch)


def labels_file(folder: Path, *rows: str) -> Path:
    path = folder / "labels.csv"
    path.write_text("\n".join(["start,end,x,y,z", *rows]) + "\n")
    return path


def tuned(folder: Path, vary: Sequence[str] = VARY, **options: Any) -> Tuned:
    """Tune on the times of contact, in steps that come a tenth of a second after the readings."""
    times = options.pop("times", TIMES)
    labels = labels_file(folder, *(f"{start},{end},0.1,0,0" for start, end in times))
    made = options.pop("made", [])
    readings = options.pop("readings", lambda: seen(TIMES))
    out = options.pop("out", folder / "out")
    return tune_fusion(makes(made), readings, labels, out, vary=vary, **options)


# Labels


def test_labels_are_read_with_and_without_a_place(tmp_path: Path) -> None:
    path = labels_file(tmp_path, "1, 2.5, 0.1, 0, -0.2", "", "3,4,,,")
    assert read_labels(path) == [Label(1.0, 2.5, (0.1, 0.0, -0.2)), Label(3.0, 4.0, None)]


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        (["1,2,,,", "0,0.5,,,"], "line 3: a label that begins at 0 s follows one that ends at 2 s"),
        (["1,2,,,", "", "1.5,3,,,"], "line 4: a label that begins at 1.5 s follows"),
        (["2,1,,,", "3,4,,,"], "line 2: the label ends at 1 s, but starts at 2 s"),
        (["1,1,,,", "3,4,,,"], "line 2: the label ends at 1 s, but starts at 1 s"),
        (["nan,2,,,", "3,4,,,"], "line 2: start is nan, not a finite number"),
        (["1,2,inf,0,0", "3,4,,,"], "line 2: x is inf, not a finite number"),
        (["1,2,0.1,,0", "3,4,,,"], "line 2: give x, y and z, or none of them"),
        (["1,soon,,,", "3,4,,,"], "line 2: end is 'soon', not a number"),
        (["1,,,,", "3,4,,,"], "line 2: a label needs its start and its end"),
        (["1,2,,,,7", "3,4,,,"], "line 2: there are more values than columns"),
        (["1,2,,,"], "holds 1 of at least two contacts"),
        ([], "holds 0 of at least two contacts"),
    ],
)
def test_labels_that_make_no_sense_are_refused(
    tmp_path: Path, rows: list[str], sentence: str
) -> None:
    with pytest.raises(ConfigurationError) as error:
        read_labels(labels_file(tmp_path, *rows))
    assert sentence in str(error.value) and "\n" not in str(error.value)


def test_other_columns_and_missing_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("from,to\n1,2\n")
    with pytest.raises(ConfigurationError, match="the first line must be start,end,x,y,z"):
        read_labels(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="is no CSV text"):
        read_labels(path)
    with pytest.raises(ConfigurationError, match="did you mean 'labels.csv'"):
        read_labels(tmp_path / "label.csv")


def test_labels_outside_the_recording_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="from 30 s to 31 s lies outside the recording"):
        tuned(tmp_path, times=[(2.0, 4.0), (30.0, 31.0)])
    require_within([Label(0.0, 1.0, None)], 0.5, 2.0, Path())


def test_the_halves_part_in_a_gap_with_half_the_labels_before() -> None:
    labels = [Label(start, end, None) for start, end in TIMES]
    assert halving(labels) == 10.0
    assert halving(labels[:3]) == 5.0


# Scores


def test_missed_false_and_misplaced_contacts_are_told_apart() -> None:
    rounds = [
        (0.0, [cloud("skin", 0.0, {})]),
        (1.0, [cloud("skin", 1.0, {HERE: 0.5})]),  # false
        (2.0, [cloud("skin", 2.0, {HERE: 0.5})]),  # right
        (3.0, [cloud("skin", 3.0, {})]),  # missed
        (4.0, [cloud("skin", 4.0, {THERE: 0.5})]),  # missed: told elsewhere
        (5.0, [cloud("skin", 5.0, {THERE: 0.5})]),  # right: somewhere
    ]
    x, y, z = centres([HERE])[0]
    labels = [Label(2.0, 5.0, (x, y, z)), Label(5.0, 6.0, None)]
    steps = stepped(*rounds, plugs={"skin": REGULAR})
    score = scored(steps, labels, 10.0, 0.03)
    half, other = score.halves
    assert (half.missed.steps, half.missed.wrong) == (4, 2)
    assert (half.false.steps, half.false.wrong) == (2, 1)
    assert half.cost == pytest.approx(2 / 4 + 1 / 2)
    assert half.errors.count == 2 and half.errors.at(1.0) == pytest.approx(0.2)
    assert (score.first, score.last) == (0.0, 5.0)
    assert math.isnan(other.missed.share) and other.cost == 0.0


@pytest.mark.parametrize(("wrong", "samples"), [(0, 7), (3, 7), (7, 7), (40, 1000)])
def test_the_interval_is_wilsons(wrong: int, samples: int) -> None:
    expected = binomtest(wrong, samples).proportion_ci(0.95, "wilson")
    assert wilson(wrong / samples, samples) == pytest.approx((expected.low, expected.high))


def test_steps_close_together_count_as_one_sample() -> None:
    often, seldom = Rate(), Rate()
    for n in range(1000):
        often.add(0.01 * n, wrong=n % 2 == 0)
    for n in range(20):
        seldom.add(0.5 * n, wrong=n % 2 == 0)
    assert often.interval == pytest.approx(seldom.interval)
    assert all(math.isnan(end) for end in Rate().interval)


def test_a_score_survives_its_file() -> None:
    half = Half(Rate(10, 2, 3), Rate(20, 1, 5))
    half.errors.add(0.01)
    again = Half.from_dict(json.loads(json.dumps(half.as_dict())))
    assert again.as_dict() == half.as_dict() and again.error == half.error


# Fields


def test_threshold_tolerance_timeout_and_scales_are_varied_by_default() -> None:
    fields = fields_to_vary(makes([])(()), ())
    assert {one.path: one.configured for one in fields} == {
        "integrator.threshold": 0.1,
        "integrator.tolerance": 0.01,
        "integrator.timeout": 0.3,
        "generators.eye.scale": 0.01,
    }
    assert all(len(one.values) == len(LADDER) for one in fields)


@pytest.mark.parametrize("condensation", ["members", "threshold"])
def test_a_tolerance_is_varied_where_voxels_form_clusters(condensation: str) -> None:
    integrator = {"condensation": condensation, "threshold": 0.6}
    fields = fields_to_vary(makes([], integrator=integrator)(()), ())
    paths = [field.path for field in fields]
    assert paths[0] == "integrator.threshold" and "integrator.tolerance" not in paths


def test_a_ladder_leaves_out_what_a_field_may_not_hold() -> None:
    (threshold, *_) = fields_to_vary(makes([], integrator={"threshold": 0.6})(()), ())
    assert threshold.values == (0.15, 0.3, 0.42, 0.6, 0.84)


def test_timeouts_of_generators_are_varied_where_they_have_one() -> None:
    generators = {"eye": {"type": "eye", "timeout": 0.2}}
    paths = [one.path for one in fields_to_vary(makes([], generators=generators)(()), ())]
    assert "generators.eye.timeout" in paths and "integrator.timeout" not in paths


def test_values_may_be_given_and_what_is_configured_is_among_them() -> None:
    vary = ("integrator.threshold=0.5, 5e-2", "integrator.rule=sets")
    threshold, rule = fields_to_vary(makes([])(()), vary)
    assert threshold.values == (0.05, 0.1, 0.5)
    assert rule.values == ("sets", "de_morgan") and rule.configured == "de_morgan"


@pytest.mark.parametrize(
    ("vary", "sentence"),
    [
        ("integrator.treshold=0.1", "unknown field 'integrator.treshold'; did you mean"),
        ("generators.eye.lambda=0.1", "unknown field 'generators.eye.lambda'; the fields are"),
        ("generators.nose.scale=1", "did you mean 'generators.eye'"),
        ("integrator.threshold=nan", "'integrator.threshold=nan': nan is not a finite number"),
        ("integrator.threshold=.inf", ".inf is not a finite number"),
        ("integrator.threshold=2", "integrator.threshold: input should be less than or equal to 1"),
        ("integrator.threshold=low", "integrator.threshold: input should be a valid number"),
        ("generators.eye.scale=-1", "generators.eye.scale: input should be greater than 0"),
        ("integrator.threshold", "varies nothing; write it as FIELD=value,value"),
        ("integrator.rule_options={}", "holds several fields; vary one of them"),
        ("integrator.threshold=0.1,,0.2", "'' is no value"),
    ],
)
def test_what_cannot_be_varied_is_refused(vary: str, sentence: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        fields_to_vary(makes([])(()), (vary,))
    assert sentence in str(error.value) and "\n" not in str(error.value)


def test_a_field_is_varied_once() -> None:
    with pytest.raises(ConfigurationError, match="'integrator.threshold' is to be varied twice"):
        fields_to_vary(makes([])(()), VARY * 2)


@pytest.mark.parametrize("value", [1e-05, 0.1, 3, "de_morgan", True])
def test_a_change_is_read_back_as_it_was(value: Any) -> None:
    assert with_overrides({"a": {}}, [override("a.b", value)])["a"]["b"] == value


# Tuning


def test_the_setting_that_fits_is_chosen_and_reported(tmp_path: Path) -> None:
    found = tuned(tmp_path)
    assert set_line(found) == "--set integrator.threshold=0.4" and found.is_better
    before, after = found.configured.reported_on, found.chosen.reported_on
    assert before.false.share > 0.9 and before.missed.share == 0.0
    assert after.false.share < 0.05 and after.missed.share < 0.1
    assert after.error < 0.005
    assert advice(found).startswith("use --set integrator.threshold=0.4\non the second half it")


def test_what_fits_the_first_half_alone_is_not_advised(tmp_path: Path) -> None:
    def fading() -> Iterator[Reading]:
        near, faint = list(seen(TIMES)), list(seen(TIMES, near=0.015, far=0.1))
        yield from [*near[:100], *faint[100:]]  # from 10 s on 0.31 is all there is

    found = tuned(tmp_path, readings=fading)
    assert set_line(found) == "--set integrator.threshold=0.4" and not found.is_better
    assert advice(found).startswith("keep what is configured: --set integrator.threshold=0.4 is")


def test_where_nothing_is_better_nothing_is_changed(tmp_path: Path) -> None:
    found = tuned(tmp_path, readings=lambda: seen(TIMES, far=0.2))
    assert found.chosen is found.configured and set_line(found) == ""
    assert advice(found) == (
        "keep what is configured: nothing that was tried is better on the first half"
    )


def test_changes_that_help_are_tried_together(tmp_path: Path) -> None:
    vary = ("integrator.threshold=0.1,0.4", "integrator.timeout=0.3,0.05")
    found = tuned(tmp_path, vary, readings=lambda: seen(TIMES, far=0.02))
    changes = [one.overrides for one in found.trials()]
    assert changes[0] == () and ("integrator.threshold=0.4",) in changes
    assert (found.together is None) == (found.best["integrator.timeout"].overrides == ())


def test_a_tuning_that_was_stopped_goes_on(tmp_path: Path) -> None:
    made: list[Sequence[str]] = []
    first = table(tuned(tmp_path, made=made))
    assert made == [(), (), ("integrator.threshold=0.4",)]
    kept_in(tmp_path / "out", ("integrator.threshold=0.4",)).unlink()
    made.clear()
    assert table(tuned(tmp_path, made=made)) == first
    assert made == [(), ("integrator.threshold=0.4",)]
    made.clear()
    tuned(tmp_path, ("integrator.threshold=0.2,0.4",), made=made)
    assert made == [(), ("integrator.threshold=0.2",)]


def test_a_folder_of_other_inputs_is_refused(tmp_path: Path) -> None:
    tuned(tmp_path)
    with pytest.raises(ConfigurationError, match="holds work of other labels"):
        tuned(tmp_path, times=TIMES[:3])
    with pytest.raises(ConfigurationError, match="holds work of other within"):
        tuned(tmp_path, within=0.05)
    with pytest.raises(ConfigurationError, match="holds work of other recording"):
        tuned(tmp_path, inputs={"push.mcap": "abc"})


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    tuned(tmp_path)
    path = kept_in(tmp_path / "out", ())
    for content in (path.read_text()[:-20], "[" * 100_000):
        path.write_text(content)
        with pytest.raises(ConfigurationError, match="configured.json is damaged: remove it"):
            tuned(tmp_path)


@pytest.mark.parametrize("within", [0.0, -1.0, math.nan])
def test_a_distance_that_is_none_is_refused(tmp_path: Path, within: float) -> None:
    with pytest.raises(ConfigurationError, match="the distance within which a contact is right"):
        tuned(tmp_path, within=within)


def test_a_recording_without_steps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="leads to no step"):
        tuned(tmp_path, readings=lambda: iter(()))


def test_names_of_kept_runs_are_names_of_files() -> None:
    name = kept_in(Path("out"), ("generators.a.path=../x", "b=" + "y" * 300)).name
    assert "/" not in name and len(name) < 160 and name.endswith(".json")


def test_a_recording_is_known_by_its_content(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    one = tmp_path / "bag" / "one.csv"
    one.write_text("1")
    before = fingerprint(tmp_path / "bag")
    assert list(before) == ["bag/one.csv"]
    one.write_text("2")
    assert fingerprint(tmp_path / "bag") != before
    assert list(fingerprint(one)) == ["one.csv"]


# What is written


def test_table_and_files_tell_every_run_of_both_halves(tmp_path: Path) -> None:
    found = tuned(tmp_path)
    lines = table(found).split("\n")
    assert lines[2].startswith("as configured") and lines[3].startswith(
        "integrator.threshold=0.4 *"
    )
    rows = list(csv.DictReader(io.StringIO(as_csv(found))))
    assert [(row["set"], row["half"], row["chosen"]) for row in rows] == [
        ("", "1", "False"),
        ("", "2", "False"),
        ("integrator.threshold=0.4", "1", "True"),
        ("integrator.threshold=0.4", "2", "True"),
    ]
    held = json.loads(as_json(found))
    assert held["chosen"] == ["integrator.threshold=0.4"] and held["better_on_second_half"]
    assert held["best_by_field"] == {"integrator.threshold": 0.4}
    paths = write_tuning(found, tmp_path / "out")
    assert [path.name for path in paths] == ["tuning.csv", "tuning.json"]
    assert write_picture(found, tmp_path / "out").read_bytes().startswith(b"\x89PNG")


def test_the_name_of_a_source_in_a_field_ends_no_row(tmp_path: Path) -> None:
    found = tuned(tmp_path)
    odd = replace(found.chosen, overrides=("generators.eye\nas configured.floor=1",))
    told = table(replace(found, together=None, curves={"odd": (odd,)}, chosen=odd))
    assert sum(line.startswith("as configured") for line in told.split("\n")) == 1


def test_a_field_that_changes_nothing_has_one_line(tmp_path: Path) -> None:
    lines = table(tuned(tmp_path, ("integrator.tolerance=0.01,0.02,0.03",))).split("\n")
    assert lines[3] == "no value of integrator.tolerance that was tried makes a difference"


def test_words_are_varied_and_drawn_too(tmp_path: Path) -> None:
    found = tuned(tmp_path, ("integrator.rule=de_morgan,sets",))
    assert len(list(found.trials())) == 2
    assert write_picture(found, tmp_path / "out").is_file()


def test_the_configuration_stays_as_it_is() -> None:
    before = json.dumps(CONFIG)
    makes([])(("integrator.threshold=0.4",))
    assert json.dumps(CONFIG) == before

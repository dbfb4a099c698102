"""Sentences on errors, of models and of predictions, hold the numbers of their keys."""

from __future__ import annotations

import pytest

from experiments.text.tables import errors_table
from experiments.text.verdicts import answer
from tests.experiments.made_up import errors, identification


@pytest.mark.parametrize(
    ("loss", "final", "good"), [(20.0, 1.0, True), (180.0, 9.0, False), (20.0, 9.0, None)]
)
def test_the_verdict_weighs_both_measures(loss: float, final: float, good: bool | None) -> None:
    measures = ("tension_loss_error_percent_median", "final_tension_error_percent_median")
    own = errors(1.0) | dict(zip(measures, (loss, final), strict=True))
    rest = errors(1.0) | dict(zip(measures, (100.0, 2.0), strict=True))
    section = {"errors": {"training": own, "hold_out": errors(0, 0), "no_loosening": {"training": rest}}}
    found = answer("model", {"identification": section})
    assert found is not None
    assert found.good is good
    assert "none was held out" in found.sentences[0]


@pytest.mark.parametrize(
    ("fitted", "question", "verdict", "words"),
    [
        (
            True,
            "Does the model meet the campaign that it was fitted to?",
            "On the campaign of its fit, the model is off by",
            "2 records here were not fitted: the error of the displacements is 1.23 % (NRMSE), where noise "
            "alone would give 0.770 %; that of the loss of tension 21.4 % (median; noise alone: 2.50 %).",
        ),
        (
            False,
            "Does the model predict a campaign to which it was not fitted?",
            "With nothing fitted, the model is off by",
            "14 records compared",
        ),
        (
            None,
            "Does the model predict this campaign?",
            "The model is off by",
            "file does not say which campaign it was fitted to",
        ),
    ],
)
def test_a_prediction_says_whose_campaign_it_is_and_what_noise_alone_would_make(
    fitted: bool | None, question: str, verdict: str, words: str
) -> None:
    floor = {"motion_nrmse": 0.0099, "tension_loss_error_percent_median": 1.5}
    floor["tension_loss_error_percent_median_with_variability"] = 18.0
    data = {
        "errors": errors(1.0), "noise_floor": floor, "fitted_to_this_campaign": fitted,
        "sets": {
            "errors": {"hold_out": errors(1.0, 2)},
            "noise_floor": {"hold_out": {"motion_nrmse": 0.0077, "tension_loss_error_percent_median": 2.5}},
        },
    }  # fmt: skip
    found = answer("prediction", data)
    assert found is not None
    assert found.question == question
    assert found.verdict.startswith(verdict)
    text = " ".join((found.verdict, *found.sentences))
    assert words in text
    assert "1.23 % (NRMSE), where noise alone would give 0.990 %" in text
    assert "noise alone: 1.50 %, with the variability between tests: 18.0 %" in text
    table = errors_table(data["errors"], "", floor)
    assert table is not None
    assert ("– noise alone would give [%]", "0.990") in table.rows


def test_every_number_in_a_sentence_is_that_of_its_key() -> None:
    """Errors differ from each other, so that one in the place of another is another sentence."""
    found = answer("model", {"identification": identification()})
    assert found is not None
    assert found.verdict == (
        "The tension law predicts more than a bolt that never loosens: it is off by 21.4 % of a record's "
        "loss (median), no loosening by 96.3 %."
    )
    final = "The final tension is off by 1.15 % (median; mean 3.66 %, largest 62.8 %)"
    small = "Where a loss is a small share of the tension, this measure is small for any law."
    assert found.sentences == (
        "The model was identified from 40 records and checked on records that no fit has seen.",
        f"{final}, without loosening by 5.17 %. {small}",
        "The courses of the tension after the hits lie within their 95 % limits for 93.0 % of the time.",
        "The error of the displacements is 1.23 % (NRMSE).",
        "1 record of doubtful quality set aside, listed below.",
        "1 warning, listed below.",
    )
    assert [one.shown for one in found.headlines] == ["21.4 %", "1.15 %", "1.23 %"]
    bands = [{"low": 1.0, "high": 2.0, "measured": measured} for measured in (0.9, 1.5, 2.1, 1.9, 1.0)]
    records = [{"final_tension_n": band} for band in (*bands, {"low": None, "high": None, "measured": 1.5})]
    told = answer("prediction", {"errors": errors(1.0) | {"failed": 2}, "records": records})
    assert told is not None
    assert told.sentences == (
        "14 records compared; 2 simulations did not finish.",
        "The error of the displacements is 1.23 % (NRMSE): the model does not describe the motion.",
        f"{final}. {small}",
        "3 of 5 measured final tensions lie within their 95 % limits.",
        "The model's file does not say which campaign it was fitted to.",
    )
    assert [one.shown for one in told.headlines] == ["21.4 %", "1.15 %", "1.23 %"]


def test_a_prediction_of_records_that_were_all_fitted_says_so() -> None:
    found = answer("prediction", {"errors": errors(1.0), "fitted_to_this_campaign": True, "sets": {}})
    assert found is not None
    assert found.sentences[-1] == "The model was fitted to all of these records."


@pytest.mark.parametrize(("kind", "whose"), [("ranking", "The identified model"), ("closure", "The model")])
def test_a_ranking_says_which_model_does_not_describe_the_records(kind: str, whose: str) -> None:
    unfit = "the model does not describe the records: displacements are off by 82.8 %"
    found = answer(kind, {"laws": [], "unfit": unfit})
    assert found is not None
    assert found.verdict == f"{whose} does not describe the records: displacements are off by 82.8 %."
    assert found.good is False


ALONE = dict.fromkeys(errors(1.0), None) | {"records": 3, "failed": 0}


@pytest.mark.parametrize(
    ("key", "value", "noise", "words"),
    [
        (
            "link_force_nrmse",
            0.123,
            0.045,
            "link force is 12.3 % (NRMSE), where noise alone would give 4.50 %",
        ),
        ("link_force_nrmse", 0.7, 0.1, "would give 10.0 %: the model does not describe the force"),
        ("tension_rmse_n", 12.5, 2.5, "tension at rest is 12.5 N (RMS), where noise alone would give 2.50 N"),
        (
            "motion_nrmse",
            0.034,
            0.012,
            "displacements is 3.40 % (NRMSE), where noise alone would give 1.20 %",
        ),
    ],
)
def test_records_that_loosen_no_bolt_are_judged_by_what_they_measure(
    key: str, value: float, noise: float, words: str
) -> None:
    own, floor = ALONE | {key: value}, {key: noise}
    section = {
        "records": 1,
        "errors": {"training": own, "hold_out": ALONE | {"records": 0}, "no_loosening": {"training": own}},
        "noise_floor": {"training": floor},
    }
    model = answer("model", {"identification": section, "links": [{"law": "linear"}]})
    prediction = answer("prediction", {"errors": own, "noise_floor": floor})
    for found in (model, prediction):
        assert found is not None
        assert words in found.verdict
        assert "loosen" not in " ".join((found.question, found.verdict, *found.sentences))
        assert "nothing to compare" not in found.verdict
        assert [line.raw for line in found.headlines] == ([value] if key.endswith("nrmse") else [])
    assert model is not None
    assert model.good is (False if value == 0.7 else None)
    assert "1 record and" in model.sentences[0]
    table = errors_table(section["errors"], "")
    assert table is not None
    assert table.columns == ("", "Training")
    bolted = answer("model", {"identification": section, "links": [{"law": "bolted"}]})
    assert bolted is not None
    assert "No loosening record measures the tension of the bolt." in bolted.sentences


def test_nothing_to_compare_is_said_where_no_error_is_known() -> None:
    found = answer("prediction", {"errors": ALONE})
    assert found is not None
    assert "nothing to compare it with" in found.verdict

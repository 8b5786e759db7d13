"""Sections from plain objects, and the parts they are made of."""

import re
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest

from estimators.trust.residual_analysis import ResidualAnalysis
from estimators.uncertainty.cross_check import CrossCheck
from estimators.uncertainty.identifiability import identifiability
from reports.commands.report import study_names
from reports.drawing.page_budget import BUDGET, lines_drawn
from reports.drawing.uncertainty_figures import three_ticks
from reports.pages import comparison
from reports.parts import Column, Number, Section, numbers, table
from reports.sections import cross_check, residuals
from reports.sections import identifiability as weak_directions
from reports.sections.fit import reached_words
from reports.template import filled, page
from reports.terminal.study_summary import misfit_lines


def words(section):
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", section.body)).split())


def analysis(**changes):
    content = {
        "chi2": 96.0,
        "dof": 100.0,
        "p_value": 0.59,
        "reduced_cost": 0.96,
        "position_chi2": np.array([20.0, 76.0]),
        "position_dof": np.array([50.0, 50.0]),
        "element_chi2": np.array([[40.0, np.nan]]),
        "element_dof": np.array([[50.0, np.nan]]),
        "autocorrelation": np.zeros(5),
        "position_autocorrelation": np.zeros(2),
        "whiteness_p_value": 0.4,
        "outlying": np.array([], dtype=np.int64),
    }
    return ResidualAnalysis(**content | changes)


def test_residuals_of_noise():
    found = residuals.section(analysis(), ("m1",), ("m1", "m2"))
    assert "explains the data to within the noise" in words(found)
    assert "fit worse" not in words(found)
    assert "0.80 –" in words(found)


def test_residuals_that_are_more_than_noise():
    bad = analysis(chi2=900.0, p_value=1e-12, outlying=np.array([1]))
    found = residuals.section(bad, ("m1",), ("m1", "m2"))
    assert "does not explain the data" in words(found)
    assert "< 0.0001" in words(found)
    assert "worse than the others: 2." in words(found)
    [(_, said)] = misfit_lines(SimpleNamespace(residuals=bad))
    assert said == "TOO SMALL: squared residuals are 9.0 times what noise explains"
    assert misfit_lines(SimpleNamespace(residuals=analysis())) == []


def test_cross_check_says_why():
    found = CrossCheck(
        names=("a.stiffness", "b.damping"),
        values=np.ones(2),
        methods=("Theorem 1", "posterior"),
        stds=np.array([[0.01, 0.5], [0.011, np.nan]]),
        verdicts=("agree", "not identifiable"),
        evidence=((), ("flat above", "hits a bound")),
        notes=("chains left out",),
        covering=("posterior",),
    )
    said = words(cross_check.section(found))
    assert "agree for 1 parameter, not identifiable for 1 parameter." in said
    assert "b.damping not identifiable flat above; hits a bound" in said
    assert "Of every parameter" not in said
    assert "Chains left out." in said
    assert "often enough: posterior." in said


def test_weak_directions_are_spelt_out():
    information = np.array([[1.0, -0.999, 0], [-0.999, 1.0, 0], [0, 0, 1e4]])
    found = identifiability(information, ("a.stiffness", "b.stiffness", "c.stiffness"))
    said = words(weak_directions.section(found))
    assert "0.71 a.stiffness + 0.71 b.stiffness" in said
    assert "What helps." in said


def test_certain_directions_need_no_advice():
    found = identifiability(np.diag([1e4, 1e6]), ("a.damping", "b.damping"))
    said = words(weak_directions.section(found))
    assert "None is weak." in said
    assert "What helps." not in said


def test_tables_keep_numbers_exact_and_units_whole():
    shown = table(
        "t", "A table.", [Column("of"), *numbers("mass [kg m²]")], [("a<b", Number("1.2", 1.23456))]
    )
    text = filled("comparison_overview.html.j2", overview=shown)
    assert 'data-v="1.23456"' in text
    assert "a&lt;b" in text
    assert "[kg\u00a0m²]" in text


def test_a_page_escapes_names_and_lists_its_sections():
    text = page("<robot>", "kind", "kicker", "lead", [Section("one", "A & B", "x > y")])
    assert "<h1>&lt;robot&gt;</h1>" in text
    assert '<a href="#one">A &amp; B</a>' in text
    assert "x &gt; y" in text


@pytest.mark.parametrize(
    "shape", [(1, 80, 2, 2), (15, 80, 6, 6), (28, 200, 6, 6), (100, 500, 6, 6)]
)
def test_as_many_lines_are_drawn_as_fit(shape):
    positions, lines, m, n = shape
    drawn = lines_drawn(shape)
    assert drawn[0] == 0
    assert drawn[-1] == lines - 1
    assert np.ptp(np.diff(drawn)) <= 1
    room = BUDGET / (positions * m * n)  # [bytes]
    assert len(drawn) == min(lines, 20) or 900 + 46 * len(drawn) <= room
    assert len(drawn) == lines or 900 + 46 * (len(drawn) + 1) > room


def test_what_led_to_every_verdict_alike_is_told_once():
    found = CrossCheck(
        names=("a.stiffness", "b.damping"),
        values=np.ones(2),
        methods=("Theorem 1",),
        stds=np.array([[0.01, 0.5]]),
        verdicts=("model error suspected",) * 2,
        evidence=(("noise explains little", "9 times wider"), ("noise explains little",)),
        notes=(),
        covering=None,
    )
    said = words(cross_check.section(found))
    assert said.count("noise explains little") == 1
    assert [row[0] for row in cross_check.reason_table(found).groups[0][1]] == ["a.stiffness"]


def test_residuals_of_one_position_need_no_picture():
    one = analysis(position_chi2=np.array([96.0]), position_dof=np.array([100.0]))
    assert residuals.by_position(one) is None
    assert "position by position" not in words(residuals.section(one, ("m1",), ("m1", "m2")))
    assert residuals.by_position(analysis()) is not None


def test_cross_check_without_reasons_has_no_table_of_them():
    found = CrossCheck(
        names=("a.stiffness",),
        values=np.ones(1),
        methods=("Theorem 1",),
        stds=np.array([[0.01]]),
        verdicts=("agree",),
        evidence=((),),
        notes=(),
        covering=None,
    )
    assert [column.title for column in cross_check.verdict_table(found).columns] == [
        "parameter",
        "Theorem 1",
        "verdict",
    ]
    assert cross_check.reason_table(found) is None


def test_ticks_of_a_corner_leave_room_for_their_words():
    assert three_ticks(-1.7, 1.6) == [-1.0, 0.0, 1.0]
    assert three_ticks(-0.031, 0.04) == pytest.approx([-0.02, 0.0, 0.02])
    assert three_ticks(0.5, 2.0) == [0.5, 2.0]


def test_estimates_of_different_robots_are_not_compared(tmp_path):
    robots = {name: SimpleNamespace(robot=SimpleNamespace(name=name)) for name in ("a", "b")}
    assert comparison.estimates(robots) == []
    assert comparison.settings_of({"seed": 1, "fit": {"starts": None}}) == {
        "seed": "1",
        "fit.starts": "–",
    }


def test_studies_are_named_after_their_files_or_folders(tmp_path):
    named = [tmp_path / "arm" / "study.yaml", tmp_path / "arm" / "more.yaml"]
    assert study_names(named) == ["arm", "more"]
    same = [tmp_path / folder / "x.yaml" for folder in ("a", "b")]
    assert study_names(same) == [str(path.with_suffix("")) for path in same]


def test_estimators_that_did_alike_are_named_together():
    assert reached_words([("LLS", 4, 4), ("NLS", 4, 4)]) == "all 4 with LLS and NLS"
    assert reached_words([("LLS", 3, 4), ("NLS", 4, 4)]) == "3 of 4 with LLS; all 4 with NLS"
    assert reached_words([("NLS", 1, 1)]) == "1 of 1 with NLS"

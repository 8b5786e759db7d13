"""Sections from plain objects, and the parts they are made of."""

import re
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest

from estimators.trust.directed_tests import DirectedTests
from estimators.trust.intervals import VERDICTS, Verdict
from estimators.trust.line_scatter import Scatter
from estimators.trust.residual_size import ResidualSize
from estimators.trust.trust import Trust
from estimators.uncertainty.identifiability import identifiability
from estimators.uncertainty.residual_analysis import ResidualAnalysis
from estimators.validation.cross_check import CrossCheck
from oed.study.summary import Reached
from reports.commands.report import study_names
from reports.figures.corner_figure import corner_plot, corner_spans, three_ticks
from reports.figures.response_panels import BUDGET, lines_drawn
from reports.figures.svg import LIGHT
from reports.page_elements import (
    Column,
    Number,
    Section,
    filled,
    in_shared_unit,
    numbers,
    page,
    table,
)
from reports.pages import comparison
from reports.sections import cross_check, identifiability as weak_directions, residuals, tool
from reports.sections.fit import reached_words
from reports.sections.verdict import fit_banner, interval_words, quote


def words(section):
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", section.body)).split())


NO_TESTS = DirectedTests(
    (), (), *(np.zeros(0, dtype=t) for t in (int, float, float, float, int, float, float)),
    np.zeros((0, 2)),
)  # fmt: skip
TESTS = DirectedTests(
    ("delay", "payload.mass"),
    ("s", "relative"),
    np.array([0, 1]),
    np.array([1e-5, 0.03]),
    np.array([2e-5, 0.004]),
    np.array([0.6, 1e-9]),
    np.array([1, 0]),
    np.array([12.0, 0.4]),
    np.array([40.0, 40.0]),
    np.zeros((2, 2)),
)


def trusted(*verdicts, ends=None, tests=NO_TESTS, reason="why"):
    p = len(verdicts)
    covered = {"trustworthy", "noise correlated", "noise understated", "too few blocks"}
    if ends is None:
        ends = [(0.9, 1.1) if v in covered else (np.nan, np.nan) for v in verdicts]
    return Trust(
        names=("a.stiffness", "b.damping", "c.damping")[:p],
        values=np.ones(p),
        scatter=Scatter(np.full(p, 0.05**2), np.full(p, 14.0)),
        ends=np.array(ends),
        method="nls, scatter of the lines over blocks",
        verdicts=verdicts,
        reasons=(reason,) * p,
        size=ResidualSize(0.96, 100.0, 80.0, 240.0, 0.59, 0.41),
        whiteness=0.4,
        lag_one=0.02,
        tests=tests,
    )


def checked(trust, stds=((0.05, 0.05), (0.051, 0.049), (0.05, 0.052)), notes=(), covering=None):
    methods = ("recommended", "Theorem 1", "posterior")[: len(stds)]
    return CrossCheck(trust, methods, np.array(stds), notes, covering)


def analysis(**changes):
    content = {
        "ratio": 0.96,
        "dof": (100.0, np.inf),
        "p_value": 0.59,
        "by_position": np.array([0.4, 1.52]),
        "by_element": np.array([[0.8, np.nan]]),
        "autocorrelation": np.zeros(5),
        "position_autocorrelation": np.zeros(2),
        "whiteness_p_value": 0.4,
        "outlying": np.array([], dtype=np.int64),
    }
    return ResidualAnalysis(**content | changes)


def residual_section(found, trust):
    elements = residuals.element_table(found.by_element, "output", ("m1",), ("from m1", "from m2"))
    return residuals.section(found, trust, elements)


def test_residuals_are_stated_in_units_of_the_noise():
    found = residual_section(analysis(), trusted("trustworthy", "trustworthy"))
    assert "0.9600 times" in words(found)
    assert "is 0.59 (100 degrees of freedom, ∞ of the noise)" in words(found)
    assert "larger residuals" not in words(found)
    assert "Model errors tested" not in words(found)
    assert "0.80 –" in words(found)


def test_residuals_that_are_more_than_noise():
    bad = analysis(ratio=9.0, p_value=1e-12, outlying=np.array([1]))
    found = residual_section(bad, trusted("model error", "model error", tests=TESTS))
    assert "9.000 times" in words(found)
    assert "< 0.0001" in words(found)
    assert "significantly larger residuals: 2." in words(found)


def test_directions_tested_come_strongest_first_with_what_they_may_hide():
    trust = trusted("model error", "model error", tests=TESTS)
    shown = residuals.direction_table(trust)
    rows = [[c if isinstance(c, str) else c.text for c in row] for row in shown.groups[0][1]]
    assert [row[0] for row in rows] == ["payload.mass", "delay"]
    assert rows[0][1] == "< 0.0001"
    assert rows[1][4] == "s"
    assert rows[1][5:] == ["12", "b.damping"]
    said = words(residual_section(analysis(), trust))
    assert "Score tests of 2 possible model errors" in said
    assert "1 is significant" in said
    many = DirectedTests(
        tuple(f"d{i}" for i in range(200)), ("relative",) * 200, np.arange(200),
        *np.ones((2, 200)), np.linspace(0.01, 1, 200), np.zeros(200, dtype=int),
        np.arange(200.0), np.ones(200), np.zeros((200, 1)),
    )  # fmt: skip
    shown = residuals.direction_table(trusted("trustworthy", tests=many)).groups[0][1]
    names = [row[0] for row in shown]
    assert names[0] == "d0"
    assert names[-1] == "d199"  # that an error could hide most in is never left out
    assert len(names) < 60


def test_cross_check_has_recommended_intervals_beside_the_others():
    trust = trusted("trustworthy", "not identifiable")
    check = checked(trust, notes=("chains left out",), covering=("posterior",))
    found = cross_check.section(check)
    said = words(found)
    assert "trustworthy for 1 parameter, not identifiable for 1 parameter." in said
    assert "Chains left out." in said
    assert "in repeated simulations: posterior." in said
    titles = [column.title for column in cross_check.verdict_table(check).columns]
    assert titles[:4] == ["parameter", "recommended [%]", "Theorem 1 [%]", "posterior [%]"]
    assert titles[-2:] == ["Theorem 1 / posterior [–]", "verdict"]


def struck(markup):
    return re.findall(r'<s title="([^"]*)"><span[^>]*>[^<]*</span>([^<]*)</s>', str(markup))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_discredited_numbers_are_struck_out(verdict):
    body = cross_check.section(checked(trusted("trustworthy", verdict))).body
    shown = struck(body)
    gives = verdict not in ("not converged", "model error", "not identifiable")
    assert len(shown) == (0 if gives else 3)
    assert all(title == f"{verdict}: why" for title, _ in shown)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_banner_says_what_to_quote(verdict):
    trust = trusted(verdict, verdict, reason="m3.inertia: 0.1 +- 0.02 (p = 4e-18)")
    said = words(SimpleNamespace(body=fit_banner(trust, checked(trust), "Measure again")))
    may = "may be quoted" if Verdict(verdict, "").gives_interval else "do not quote"
    assert re.match(f"{verdict[:1].upper()}{verdict[1:]}: .*{may}", said)
    assert said.endswith("Next: Measure again.")
    assert "m3.inertia: 0.1 ± 0.02" in said
    assert "e-18" not in said
    if Verdict(verdict, "").gives_interval:
        assert "Quote the recommended standard deviations" in said
        assert "Ratio to them: Theorem 1 0.98 to 1.02, emcee 1.00 to 1.04 (both agree)" in said
        assert "both agree" in said
    else:
        assert "Quote no standard deviation of this study." in said
        assert "agree" not in said


def test_the_banner_counts_what_may_be_quoted_and_says_who_disagrees():
    trust = trusted("trustworthy", "not identifiable")
    check = checked(trust, stds=((0.05, 0.05), (0.05, 9.0), (0.02, 9.0)))
    said = quote(trust, check)
    assert "of 1 of 2 parameters" in said
    assert "Theorem 1 agrees, emcee does not agree" in said
    assert "9" not in said  # what is refused is no part of the comparison


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((0.9, 1.1), "0.9000 to 1.100"),
        ((np.nan, 0.0123), "< 0.012"),
        ((2.5e4, np.nan), "> 25 000"),
        ((np.nan, np.nan), "–"),
    ],
)
def test_intervals_in_words(ends, said):
    [one] = trusted("not identifiable", ends=[ends]).intervals
    assert interval_words(one).replace("\u202f", " ") == said


def test_weak_directions_are_spelt_out():
    information = np.array([[1.0, -0.999, 0], [-0.999, 1.0, 0], [0, 0, 1e4]])
    found = identifiability(information, ("a.stiffness", "b.stiffness", "c.stiffness"))
    said = words(weak_directions.section(found))
    assert "0.71 a.stiffness + 0.71 b.stiffness" in said
    assert "Remedy." in said


def test_certain_directions_need_no_advice():
    found = identifiability(np.diag([1e4, 1e6]), ("a.damping", "b.damping"))
    said = words(weak_directions.section(found))
    assert "None is weak." in said
    assert "Remedy." not in said


def test_tables_keep_numbers_exact_and_units_whole():
    shown = table(
        "t", "A table.", [Column("of"), *numbers("mass [kg m²]")], [("a<b", Number("1.2", 1.23456))]
    )
    text = filled("comparison_overview.html.j2", overview=shown)
    assert 'data-v="1.23456"' in text
    assert "a&lt;b" in text
    assert "[kg\u00a0m²]" in text


def test_numbers_without_a_dimension_say_so_and_counts_say_of_what():
    titles = ("p-value", "Theorem 1 / posterior", "relative efficiency, predicted")
    assert [one.title for one in numbers(*titles)] == [f"{title} [–]" for title in titles]
    plain = ("visits", "std [%]", "torque / limit [%]", "candidates from", "estimate")
    assert [one.title for one in numbers(*plain)] == [*plain]
    assert numbers("p-value")[0].explanation == numbers("p-value [–]")[0].explanation != ""


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
    assert len(drawn) == min(lines, 20) or 600 + 18.5 * len(drawn) <= room
    assert len(drawn) == lines or 600 + 18.5 * (len(drawn) + 1) > room


def test_residuals_of_one_position_need_no_picture():
    one, trust = analysis(by_position=np.array([0.96])), trusted("trustworthy")
    assert residuals.by_position(one) is None
    assert "position by position" not in words(residual_section(one, trust))
    assert residuals.by_position(analysis()) is not None


def test_a_corner_plot_reaches_the_truth():
    draws = np.random.default_rng(1).standard_normal((500, 2))
    truth = np.array([30.0, np.nan])
    spans = corner_spans(draws, np.eye(2), truth)
    assert spans[0, 0] < -2
    assert spans[0, 1] > 30
    assert spans[1] == pytest.approx([draws[:, 1].min(), draws[:, 1].max()], abs=0.5)
    drawn = corner_plot(("a", "b"), draws, np.eye(2), truth)(LIGHT)
    first = drawn.axes[0]
    low, high = first.get_xlim()
    assert low < 30 < high
    # The draws keep their own resolution however wide the axes are.
    assert len(np.unique(first.lines[-1].get_xdata())) > 30


def test_ticks_of_a_corner_leave_room_for_their_words():
    assert three_ticks(-1.7, 1.6) == [-1.0, 0.0, 1.0]
    assert three_ticks(-0.031, 0.04) == pytest.approx([-0.02, 0.0, 0.02])
    assert three_ticks(0.5, 2.0) == [0.5, 2.0]
    assert three_ticks(-2.0, 30.0) == [0.0, 20.0]
    assert three_ticks(-30.0, 2.0) == [-20.0, 0.0]


def test_estimates_of_different_robots_are_not_compared(tmp_path):
    robots = {name: SimpleNamespace(robot=SimpleNamespace(name=name)) for name in ("a", "b")}
    assert comparison.pairwise_differences(robots) == {}
    assert comparison.estimates(robots, {}) == []
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
    assert reached_words([Reached("lls", 4, 4), Reached("nls", 4, 4)]) == "all 4 with LLS and NLS"
    assert (
        reached_words([Reached("lls", 3, 4), Reached("nls", 4, 4)])
        == "3 of 4 with LLS; all 4 with NLS"
    )
    assert reached_words([Reached("nls", 1, 1)]) == "1 of 1 with NLS"


def test_words_say_in_which_positions_the_tool_is_predicted():
    assert tool.positions_words(30, 30) == "each position"
    assert tool.positions_words(24, 30) == "the first 24 of 30 positions"


def test_of_studies_side_by_side_the_verdict_goes_before_small_standard_deviations():
    def study(verdict, mean):
        trust = SimpleNamespace(verdict=Verdict(verdict, "why"))
        return SimpleNamespace(fit_summary=SimpleNamespace(spread=(0.0, mean, 1.0)), trust=trust)

    studies = {"low": study("noise understated", 0.01), "good": study("trustworthy", 0.02)}
    best, reason = comparison.recommended(studies)
    assert best == "good"
    assert "low (noise understated), are less trustworthy" in reason
    studies["better"] = study("noise correlated", 0.015)
    assert comparison.recommended(studies)[0] == "better"
    assert comparison.recommended({"low": studies["low"]}) == (
        "low",
        "low (noise understated) has a mean standard deviation of 1.0\u202f%, the smallest",
    )
    nothing = {"none": study("model error", np.nan)}
    assert comparison.recommended(nothing) == ("", "No study has a standard deviation to quote")


def test_units_go_into_headings_where_all_rows_share_one():
    columns = [Column("joint"), *numbers("from", "mass [kg]"), Column("unit", "u"), *numbers("to")]
    rows = [("a", "1", "2", "°", "3"), ("b", "4", "5", "°", "6")]
    shared = in_shared_unit(table("t", "T.", columns, rows), "to")
    assert [c.title for c in shared.columns] == ["joint", "from [°]", "mass [kg]", "to [°]"]
    assert shared.groups[0][1][1] == ("b", "4", "5", "6")
    mixed = table("t", "T.", columns, [*rows, ("c", "1", "2", "m", "3")])
    assert in_shared_unit(mixed) is mixed

import numpy as np
import pytest

from reports import text
from reports.summaries import columns


def plain(words):
    return words.replace(text.THIN, " ")


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.0, 3, "0"),
        (1234567.0, 3, "1.23 × 10⁶"),
        (5.5e-10, 2, "5.5 × 10⁻¹⁰"),
        (9.999, 3, "10.0"),
        (0.99996, 4, "1.000"),
        (99999.6, 3, "100 000"),
        (12345.0, 3, "12 345"),
        (-0.0123, 2, "−0.012"),
        (float("nan"), 2, "–"),
    ],
)
def test_significant_digits(value, digits, shown):
    assert plain(text.significant(value, digits)) == shown


@pytest.mark.parametrize(
    ("std", "decimals"), [(0.0999, 2), (0.0995, 2), (0.0994, 3), (0.6, 2), (14.0, 0)]
)
def test_decimals_show_two_digits_of_the_standard_deviation(std, decimals):
    assert text.decimals_for(std) == decimals
    assert len(f"{std:.{text.decimals_for(std)}f}".replace(".", "").lstrip("0")) == 2


def test_no_minus_sign_before_zero():
    assert text.fixed(-0.04, 1) == "0.0"
    assert text.degrees(np.radians([-0.3])) == ["0°"]


def test_positions_of_prismatic_joints_are_in_metres():
    shown = text.format_position(np.array([-0.25, np.pi / 2]), [True, False])
    assert [plain(words) for words in shown] == [f"{text.MINUS}0.250 m", "90°"]


def test_engineering_units():
    assert text.scaled_unit(4e4, "N m/rad") == (1e3, "kN m/rad")
    assert text.scaled_unit(3.8e6, "N m/rad") == (1e6, "MN m/rad")
    assert text.scaled_unit(60.0, "N m s/rad") == (1.0, "N m s/rad")
    assert text.scaled_unit(4e4, "kg m^2") == (1.0, "kg m²")


def test_a_certified_efficiency_is_never_rounded_up():
    assert plain(text.efficiency(0.999999)) == "99.99 %"
    assert plain(text.efficiency(1.0)) == "100.00 %"
    assert plain(text.efficiency(1 - 1e-12)) == "100.00 %"


def test_what_exceeds_one():
    assert text.one_and(0.0) == "1, to rounding,"
    assert plain(text.one_and(2.4e-10)).replace(text.NO_BREAK, " ") == "1 + 2.4 × 10⁻¹⁰"


def test_minus_signs_of_numbers_are_typeset_and_hyphens_are_not():
    assert text.typeset("limit -10 rad/s of set-up 2-3") == "limit \u221210 rad/s of set-up 2-3"


def test_sentences_begin_with_a_capital_letter():
    assert text.sentence("one period") == "One period"
    assert text.sentence("") == ""
    assert text.sentence("oed campaign ask campaign.yaml").startswith("oed ")


def test_runs_of_numbers():
    assert text.ranges([1, 2, 3, 4, 7, 9, 10]) == "1 to 4, 7, 9 and 10"
    assert text.ranges([]) == ""


def test_powers_of_ten_on_a_terminal():
    assert columns.plain(text.percent(3.3e-7)) == "3.3e-5 %"
    assert columns.plain(text.significant(-1.2e8, 2)) == "-1.2e8"


def test_people_get_degrees_hertz_and_minutes():
    assert text.degrees(np.radians([-90.2, 0.1, -0.1, 45.0])) == ["−90°", "0°", "0°", "45°"]
    assert plain(text.hertz(2 * np.pi * 80)) == "80.0 Hz"
    assert [plain(text.duration(s)) for s in (0.44, 12.2, 59.9, 185.0)] == [
        "0.4 s",
        "12 s",
        "1 min 0 s",
        "3 min 5 s",
    ]


def test_words():
    assert text.plural(1, "position") == "1 position"
    assert text.plural(13, "position") == "13 positions"
    assert text.listed(["a", "b", "c"]) == "a, b and c"


def test_probabilities():
    assert text.probability(0.0312) == "0.031"
    assert text.probability(0.0) == text.probability(3e-9) == "< 0.0001"


def test_bands_have_digits_by_their_width():
    assert text.value_and_ends(5.0471, 5.0433, 5.0512) == ("5.0471", "5.0433 to 5.0512")
    assert text.value_and_ends(64.2, 41.0, 99.0) == ("64", "41 to 99")
    assert text.value_and_ends(2.0, 2.0, 2.0) == ("2.00", "2.00 to 2.00")
    assert text.value_and_ends(2.0, np.nan, np.nan) == ("2.00", "–")


def test_coverages_stand_apart_from_per_cent():
    assert [text.level(one) for one in (0.95, 0.9, 0.999)] == ["95 %", "90 %", "99.9 %"]

"""Altered data are named or refused; good data are not questioned. `python tests/door` has all."""

import pytest
from alter import FRFS, RECORDS, estimated, listed, questions
from good_data import good_data

# What is to be said, as far as the cause is known: the words of it.
WORDS = {
    "degrees": "angles look like degrees: gain 57",
    "revolutions": "angles look like revolutions",
    "milliradians": "milliradians",
    "counts": "another unit: gain 65",
    "degrees_of_one": "angle of motor 1: angles look like degrees",
    "milli_torque": "torques look like mN m",
    "current": "another unit: gain 0.1",
    "arm_angle": "angles look like those of the arm side",
    "arm_torque": "torques look like those of the arm side",
    "arm_both": "angles and torques look like those of the arm side",
    "arm_angle_of_one": "angle of motor 1: .*side of the gear",
    "torque_of_one_position": "position 1: .*gain 0.5 there alone",
    "hertz": "frequencies look like Hz",
    "twice_converted": "multiplied by 2 pi twice",
    "speed": "look like speeds",
    "angle_response": "look like angles",
    "torque_sign": "all signs are wrong",
    "torque_sign_of_one": "torque of motor 1: wrong sign",
    "angle_sign_of_one": "angle of motor 1: wrong sign",
    "both_signs_of_one": "motor 1: torque and angle are both turned round",
    "conjugate": "conjugated",
    "conjugate_of_one_position": "position 1: .*conjugated",
    "angles_swapped": "angles: motors 1 and 2 look exchanged",
    "torques_swapped": "torques: motors 1 and 2 look exchanged",
    "motors_swapped": "torques and angles: motors 1 and 2 look exchanged",
    "motors_rolled": "numbered from another one on",
    "rows_rolled": "numbered from another one on",
    "positions_swapped": "positions 1 and 2 look exchanged",
    "position_degrees": "refused: position .*limits",
    "position_signs": "positions look turned round",
    "frequencies_reversed": "refused: omega: frequency 1",
    "lines_unsorted": "refused: omega: frequency 3",
    "line_twice": "refused: omega: frequency 6",
    "magnitudes": "refused: .*magnitudes without phases",
    "positions_copied": "positions 1 and 2 have the same FRFs",
    "delay_of_one": "late",
    "slipped_run": "block 2, run 1 differs .*late",
    "slipped_block": "block 2, run 1 differs",
    "slipped_period": "periods differ|dropped",
    "drift": "from the end of a period to its start",
    "random_drift": "from the end of a period to its start",
    "wrapped": "wraps around",
    "wrapped_block": "wraps around",
    "quantised": "different values",
    "dropout": "block 2, run 1 differs",
    "gap": "refused: angle: not a finite number",
    "blocks_copied": "refused: .*blocks 1 and 2 hold the same samples",
    "one_block_copied": "refused: .*blocks 1 and 2 hold the same samples",
    "same_phases": "blocks 1 and 2 have the same phases",
    "periods_copied": "all periods hold the same samples",
    "truncated": "refused: .*samples a period",
    "not_excited": r"refused: .*2 lines, 7, 23 \(.* are declared",
}
# Named without the cause, or left to the misfit of the fit.
UNNAMED = {
    "foot_pounds",
    "peak_to_peak",
    "root_mean_square",
    "milliseconds",
    "delay_of_five",
    "advance",
    "lines_off_by_one",
    "clipped",
}


@pytest.fixture(scope="module")
def good():
    data = good_data("manutec_r3", 0)
    return data, estimated(data, data.records)[0]


def test_every_alteration_of_the_list_is_made():
    unseen = {name for name, how in listed().items() if how == "unseen"}
    # Motors that are equal in everything have no names: there is nothing to make.
    assert {*FRFS, *RECORDS} == {*listed()} - {"equal_motors_swapped"}
    assert {*WORDS, *UNNAMED} == {*listed()} - unseen


@pytest.mark.parametrize("name", WORDS)
def test_an_alteration_is_named_or_refused(good, name):
    import re

    said = questions(good[0], name, good[1])
    assert any(re.search(WORDS[name], line, re.DOTALL) for line in said), said


@pytest.mark.parametrize("name", ["foot_pounds", "peak_to_peak", "root_mean_square"])
def test_small_factors_are_noticed(good, name):
    assert any("everywhere" in line for line in questions(good[0], name, good[1]))


@pytest.mark.parametrize("name", ["transposed", "resampled"])
def test_what_cannot_be_seen(good, name):
    """Reciprocal FRFs are their transposes, and nobody but a clock tells the time."""
    assert questions(good[0], name, good[1]) == []


@pytest.mark.parametrize(
    "robot", ["manutec_r3", pytest.param("ur10", marks=pytest.mark.slow), "moberg_axis1"]
)
def test_good_data_are_not_questioned(robot):
    assert questions(good_data(robot, 1), "") == []

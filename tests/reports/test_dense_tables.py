"""Tables are set closer by the length of their cells."""

from reports.page_elements import Column, table


def test_long_rows_are_set_closer_and_text_that_wraps_is_not():
    long, words = "12.345 to 12.678", "a remark that goes on " * 10
    many = table("a", "", [Column(str(k), "n") for k in range(8)], [["1"] * 8, [long] * 8])
    assert many.dense
    few = table("b", "", [Column(str(k), "n") for k in range(4)], [[long] * 4])
    assert not few.dense
    told = [Column("what"), Column("why", "words")]
    assert not table("c", "", told, [["speed", words]]).dense
    assert not table("d", "", told, []).dense

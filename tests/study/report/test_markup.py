"""HTML: whatever is read from a file is text."""

import math

from surefoot.study.report.markup import MISSING, code, element, escaped, number, table
from surefoot.study.report.numbers import Number
from surefoot.study.report.panels import Quantity

NASTY = "<script>\"&'</script>"


def test_text_cannot_become_markup():
    for made in (escaped(NASTY), code(NASTY), element("a", escaped(NASTY), {"title": NASTY})):
        assert "<script>" not in made
    assert "<script>" not in table(NASTY, [NASTY], [[escaped(NASTY)]])


def test_a_number_keeps_its_value_and_its_source():
    made = number(Number(0.123456, "F#/a"), Quantity("share", "%", 0.01, 1))
    assert made == '<data value="0.123456" data-source="F#/a" data-scale="0.01">12.3</data> %'


def test_a_number_that_is_not_known_is_a_dash():
    assert number(Number(math.nan, "F")) == MISSING


def test_a_small_negative_number_is_no_negative_zero():
    assert ">0</data>" in number(Number(-0.2, "F"))

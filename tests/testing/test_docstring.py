"""The example with which the contracts begin is a test class under unittest too."""

import re
import textwrap
import types
import unittest

import surefoot.testing


def test_unittest_finds_the_tests_of_the_example():
    text = surefoot.testing.__doc__
    assert text is not None
    block = re.search(r":\n\n((?:    .*\n|\n)+)", text)
    assert block is not None
    mine = types.ModuleType("mine")
    exec(textwrap.dedent(block[1]), vars(mine))
    found = unittest.TestLoader().loadTestsFromModule(mine)
    assert found.countTestCases() > 10

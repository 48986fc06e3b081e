"""Contract tests that your own simulator, plan, gate or controller can inherit.

Each contract is a class of test methods, plus methods for you to write that make what is tested.
Your test class inherits it, and runs under both pytest and unittest; pytest needs no `TestCase`:

    import unittest

    from surefoot.testing import SimulatorContract

    class TestMySimulator(SimulatorContract, unittest.TestCase):
        def make_simulator(self, batch):
            return MySimulator(solo12(), batch)

The tests need only numpy's assertions. They check what the rest of the package relies on, such as
rows of a batch that never affect each other; they do not check whether your physics or your planner
is any good. Read `testing.simulator` next.
"""

from __future__ import annotations

from surefoot.testing.controller import ControllerContract
from surefoot.testing.gate import GateContract
from surefoot.testing.plan import PlanContract
from surefoot.testing.simulator import SimulatorContract

__all__ = ["ControllerContract", "GateContract", "PlanContract", "SimulatorContract"]

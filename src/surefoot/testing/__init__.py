"""Contract tests that your own simulator, plan, gate or controller can inherit.

Each contract is a class of test methods and one method that makes what is tested. A test class of
your own inherits it, and runs under pytest and unittest alike; pytest alone needs no `TestCase`:

    import unittest

    from surefoot.testing import SimulatorContract

    class TestMySimulator(SimulatorContract, unittest.TestCase):
        def make_simulator(self, batch):
            return MySimulator(solo12(), batch)

The tests need numpy's assertions only. They check what the rest of the package relies on, such as
rows of a batch that never touch each other; they do not check that your physics or your planner is
a good one. Read `testing.simulator` next.
"""

from __future__ import annotations

from surefoot.testing.controller import ControllerContract
from surefoot.testing.gate import GateContract
from surefoot.testing.plan import PlanContract
from surefoot.testing.simulator import SimulatorContract

__all__ = ["ControllerContract", "GateContract", "PlanContract", "SimulatorContract"]

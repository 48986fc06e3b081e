"""What every simulator promises: masks, independent rows, resets, pushes, variation, blow-ups.

The class turns the sentences of `surefoot.sim.protocol.Simulator` into tests. It does not judge the
physics: whether feet stick and robots fall as they should is up to your simulator.
Read `testing.plan` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.robots.model import standing
from surefoot.sim.protocol import CONTACT_FORCE, Simulator
from surefoot.testing.driving import (
    assert_blows_up_alone,
    assert_same_rows,
    holding_torque,
    momentum,
    put_in_the_air,
    record_ticks,
    stamping_torque,
    thrown_states,
    vary_and_reset,
)
from surefoot.testing.states import (
    assert_same_states,
    copy_of,
    lying_on_its_back,
    states_in_the_air,
)


class SimulatorContract:
    """Tests that a simulator must pass; inherit it and make your simulator.

    Attributes:
        nominal_friction: The friction coefficient that your simulator has without `vary`.
        push_tolerance: The largest error of the momentum that a push adds [N s].
        ticks: The length of the episodes that are compared [ms].
    """

    nominal_friction: float = 0.5
    push_tolerance: float = 1e-3
    ticks: int = 200

    def make_simulator(self, batch: int) -> Simulator:
        """Return a new simulator of ``batch`` robots, which stand in the nominal pose.

        Args:
            batch: The number of robots B.
        """
        raise NotImplementedError("return a new simulator of `batch` robots")

    def test_arrays_have_their_shapes_and_types(self) -> None:
        """The state, the forces and the flags have one row for each robot."""
        simulator = self.make_simulator(3)
        assert simulator.batch == 3, f"batch is {simulator.batch} for 3 robots"
        state = simulator.state
        shapes = [np.shape(array) for array in (state.q, state.v, state.com, state.feet)]
        assert shapes == [(3, 19), (3, 18), (3, 3), (3, 4, 3)], f"q, v, com, feet are {shapes}"
        assert state.contacts.shape == (3, 4), f"contacts are {state.contacts.shape}"
        assert state.contacts.dtype == bool, f"contacts are {state.contacts.dtype}"
        assert simulator.contact_force.shape == (3, 4), "contact_force must be (B, 4)"
        assert simulator.body_contact.shape == (3,), "body_contact must be (B,)"
        assert simulator.body_contact.dtype == bool, "body_contact must be True or False"
        assert simulator.blown_up.shape == (3,), "blown_up must be (B,)"
        assert simulator.blown_up.dtype == bool, "blown_up must be True or False"
        assert not simulator.blown_up.any(), "a new simulator has blown up"

    def test_new_robots_stand_in_the_nominal_pose(self) -> None:
        """The robots of a new simulator stand in the nominal pose, at rest."""
        simulator = self.make_simulator(2)
        expected = np.tile(standing(simulator.robot), (2, 1))
        np.testing.assert_allclose(simulator.state.q, expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(simulator.state.v, np.zeros((2, 18)), rtol=0, atol=1e-9)

    def test_reset_gives_back_the_state(self) -> None:
        """After a reset, the state is the one that was given."""
        simulator = self.make_simulator(8)
        q, v = states_in_the_air(simulator.robot, 8)
        simulator.reset(q, v)
        np.testing.assert_allclose(simulator.state.q, q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(simulator.state.v, v, rtol=0, atol=1e-12)

    def test_contacts_are_the_feet_that_carry_a_force(self) -> None:
        """A foot is in contact exactly when it carries more than 0.5 N."""
        simulator = self.make_simulator(4)
        seen = np.zeros(2, dtype=bool)
        for tick in range(self.ticks):
            contacts = simulator.state.contacts
            np.testing.assert_array_equal(contacts, simulator.contact_force > CONTACT_FORCE)
            seen |= [contacts.any(), (~contacts).any()]
            simulator.step(stamping_torque(simulator.robot, simulator.state, tick))
        assert seen.all(), "the test needs feet in the air and on the ground"

    def test_only_a_robot_that_lies_touches_the_ground_with_its_body(self) -> None:
        """A robot on its back touches the ground with its base; a standing robot never does."""
        simulator = self.make_simulator(3)
        robot = simulator.robot
        q = np.array([standing(robot), lying_on_its_back(robot), standing(robot)])
        simulator.reset(q, np.zeros((3, 18)))
        assert not simulator.body_contact[[0, 2]].any(), "a reset shows a body on the ground"
        touched = np.zeros(3, dtype=bool)
        for _ in range(self.ticks):
            simulator.step(holding_torque(robot, simulator.state))
            touched |= simulator.body_contact
        assert touched.tolist() == [False, True, False], f"body contacts are {touched}"
        flags = simulator.body_contact
        simulator.step(np.zeros((3, 12)), np.array([True, False, True]))
        assert simulator.body_contact[1] == flags[1], "a robot outside the mask"
        simulator.reset(q[[0, 0, 0]], np.zeros((3, 18)))
        assert not simulator.body_contact.any(), "a reset does not end a contact"
        assert flags[1] == touched[1], "an array that was handed out has changed"

    def test_later_calls_do_not_change_arrays_handed_out(self) -> None:
        """A state belongs to the caller and may be kept."""
        simulator = self.make_simulator(2)
        state = simulator.state
        force = simulator.contact_force
        flags = simulator.blown_up
        kept = copy_of(state)
        kept_force = force.copy()
        kept_flags = flags.copy()
        for tick in range(5):
            simulator.step(stamping_torque(simulator.robot, state, tick))
        assert not np.array_equal(simulator.state.q, kept.q), "the robots did not move"
        q, v = states_in_the_air(simulator.robot, 2)
        q[0] = np.nan
        simulator.reset(q, v)
        assert_same_states(state, kept, "a state that was handed out has changed")
        np.testing.assert_array_equal(force, kept_force)
        np.testing.assert_array_equal(flags, kept_flags)

    def test_arguments_are_read_and_neither_changed_nor_kept(self) -> None:
        """A simulator copies what it is given."""
        simulator = self.make_simulator(2)
        q, v = states_in_the_air(simulator.robot, 2)
        torque = np.full((2, 12), 100.0 * simulator.robot.torque_limit)
        impulse = np.full((2, 3), 0.1)
        mask = np.array([True, True])
        arguments = [q, v, torque, impulse, mask]
        copies = [array.copy() for array in arguments]
        simulator.reset(q, v, mask)
        simulator.push(impulse, mask)
        simulator.step(torque, mask)
        for array, copy in zip(arguments, copies, strict=True):
            np.testing.assert_array_equal(array, copy, "an argument has been changed")
        before = copy_of(simulator.state)
        simulator.reset(q, v)
        after_reset = copy_of(simulator.state)
        q[:] = 7.0
        v[:] = 7.0
        assert_same_states(simulator.state, after_reset, "an argument has been kept")
        assert not np.array_equal(before.v, after_reset.v), "the robots did not move"

    def test_robots_outside_the_mask_keep_every_bit(self) -> None:
        """A step moves only the robots in its mask."""
        simulator = self.make_simulator(4)
        mask = np.array([True, False, True, False])
        for tick in range(20):
            before = copy_of(simulator.state)
            force = simulator.contact_force
            simulator.step(stamping_torque(simulator.robot, before, tick), mask)
            after = simulator.state
            assert_same_states(after[~mask], before[~mask], "a robot outside the mask")
            np.testing.assert_array_equal(simulator.contact_force[~mask], force[~mask])
            moved = (after.q[mask] != before.q[mask]).any(axis=1)
            assert moved.all(), "a robot in the mask did not move"

    def test_rows_of_a_batch_are_single_robots(self) -> None:
        """A robot moves as it would alone, bit for bit, even while other robots are not stepped."""
        batch = self.make_simulator(6)
        robot = batch.robot
        q, v = thrown_states(batch)
        batch.reset(q, v)
        singles = [self.make_simulator(1) for _ in range(6)]
        for row, single in enumerate(singles):
            single.reset(q[row : row + 1], v[row : row + 1])
        rng = np.random.default_rng(2)
        for tick in range(self.ticks):
            state = batch.state
            assert_same_rows(batch, singles)
            torque = stamping_torque(robot, state, tick)
            mask = rng.random(6) < 0.7
            batch.step(torque, mask)
            for row in np.flatnonzero(mask).tolist():
                singles[row].step(torque[row : row + 1])

    def test_an_episode_repeats_bit_for_bit_whatever_came_before(self) -> None:
        """A reset forgets pushes, blow-ups, the clock and everything else."""
        fresh = self.make_simulator(4)
        q, v = thrown_states(fresh)
        fresh.reset(q, v)
        first = record_ticks(fresh, self.ticks)
        used = self.make_simulator(4)
        record_ticks(used, self.ticks // 2)
        used.push(np.full((4, 3), 0.3))
        used.step(np.full((4, 12), np.nan), np.array([False, True, False, True]))
        assert used.blown_up.tolist() == [False, True, False, True], "NaN torques blow a robot up"
        used.reset(q, v)
        assert not used.blown_up.any(), "a reset ends a blow-up"
        np.testing.assert_array_equal(record_ticks(used, self.ticks), first)

    def test_reset_of_some_robots_leaves_the_others_alone(self) -> None:
        """A reset reads and changes only the rows in its mask."""
        reference = self.make_simulator(3)
        simulator = self.make_simulator(3)
        robot = simulator.robot
        mask = np.array([False, True, False])
        for tick in range(100):
            if tick == 50:
                q = np.where(mask[:, None], standing(robot), np.nan)
                simulator.reset(q, np.zeros((3, 18)), mask)
                np.testing.assert_allclose(
                    simulator.state.q[1], standing(robot), rtol=0, atol=1e-12
                )
            state = simulator.state
            expected = reference.state
            assert_same_states(state[~mask], expected[~mask], "a robot that was not reset")
            assert not simulator.blown_up.any(), "a row outside the mask has been read"
            reference.step(stamping_torque(robot, expected, tick))
            simulator.step(stamping_torque(robot, state, tick))

    def test_push_adds_its_impulse_to_the_momentum(self) -> None:
        """A push spread over ten ticks changes the momentum of the pushed robots by its impulse.

        It acts during these ticks only.
        """
        impulse = np.array([[0.3, -0.2, 0.1], [9.0, 9.0, 9.0], [0.0, 0.5, 0.0]])
        pushed = np.array([True, False, True])
        plain = put_in_the_air(self.make_simulator(3))
        simulator = put_in_the_air(self.make_simulator(3))
        for _ in range(10):
            simulator.push(impulse / 10, pushed)
            simulator.step(np.zeros((3, 12)))
            plain.step(np.zeros((3, 12)))
        expected = np.where(pushed[:, None], impulse, 0.0)
        for _ in range(2):
            gained = momentum(simulator) - momentum(plain)
            np.testing.assert_allclose(gained, expected, atol=self.push_tolerance)
            simulator.step(np.zeros((3, 12)))
            plain.step(np.zeros((3, 12)))

    def test_pushes_before_the_same_tick_add_up(self) -> None:
        """Two pushes act as one push of their sum; a single impulse ``(3,)`` is for every robot."""
        plain = put_in_the_air(self.make_simulator(2))
        simulator = put_in_the_air(self.make_simulator(2))
        simulator.push(np.array([0.1, 0.0, 0.0]))
        simulator.push(np.array([[0.2, 0.1, 0.0], [0.0, 0.0, 0.1]]))
        simulator.step(np.zeros((2, 12)))
        plain.step(np.zeros((2, 12)))
        gained = momentum(simulator) - momentum(plain)
        expected = [[0.3, 0.1, 0.0], [0.1, 0.0, 0.1]]
        np.testing.assert_allclose(gained, expected, atol=self.push_tolerance)

    def test_push_waits_for_a_robot_that_is_not_stepped(self) -> None:
        """A push acts during the robot's own next tick."""
        plain = put_in_the_air(self.make_simulator(2))
        simulator = put_in_the_air(self.make_simulator(2))
        before = copy_of(simulator.state)
        simulator.push(np.array([0.5, 0.0, 0.0]))
        simulator.step(np.zeros((2, 12)), np.array([True, False]))
        assert_same_states(simulator.state[1:], before[1:], "a robot that is not stepped")
        simulator.step(np.zeros((2, 12)), np.array([False, True]))
        plain.step(np.zeros((2, 12)))
        gained = momentum(simulator) - momentum(plain)
        np.testing.assert_allclose(gained, [[0.5, 0.0, 0.0]] * 2, atol=self.push_tolerance)

    def test_push_is_forgotten_by_a_reset(self) -> None:
        """A push before a reset has no effect after it."""
        plain = put_in_the_air(self.make_simulator(2))
        simulator = put_in_the_air(self.make_simulator(2))
        q = simulator.state.q.copy()
        v = simulator.state.v.copy()
        simulator.push(np.array([0.5, 0.0, 0.0]))
        plain.reset(q, v)
        simulator.reset(q, v)
        plain.step(np.zeros((2, 12)))
        simulator.step(np.zeros((2, 12)))
        assert_same_states(simulator.state, plain.state, "a push has survived a reset")

    def test_nominal_values_change_no_bit(self) -> None:
        """At nominal friction and a mass factor of 1, a robot moves as if it was never varied.

        This also holds next to robots that are varied, and for a robot that was varied before.
        """
        nominal = self.nominal_friction
        plain = record_ticks(self.make_simulator(4), self.ticks)
        simulator = self.make_simulator(4)
        vary_and_reset(simulator, np.full(4, nominal), np.ones(4))
        np.testing.assert_array_equal(record_ticks(simulator, self.ticks), plain)
        own = np.array([False, True, True, False])
        mixed = self.make_simulator(4)
        vary_and_reset(mixed, np.where(own, 0.6 * nominal, nominal), np.where(own, 1.3, 1.0))
        rows = record_ticks(mixed, self.ticks)
        np.testing.assert_array_equal(rows[:, ~own], plain[:, ~own])
        differs = (rows[-1, own, :19] != plain[-1, own, :19]).any(axis=1)
        assert differs.all(), "a variation has no effect"
        vary_and_reset(mixed, np.full(4, nominal), np.ones(4))
        np.testing.assert_array_equal(record_ticks(mixed, self.ticks), plain)

    def test_none_undoes_a_variation(self) -> None:
        """A robot that is no longer varied moves, bit for bit, like one that never was."""
        plain = record_ticks(self.make_simulator(2), self.ticks)
        simulator = self.make_simulator(2)
        vary_and_reset(simulator, None, None)
        np.testing.assert_array_equal(record_ticks(simulator, self.ticks), plain)
        vary_and_reset(simulator, np.full(2, 0.6 * self.nominal_friction), np.full(2, 1.3))
        record_ticks(simulator, 5)
        vary_and_reset(simulator, None, None)
        np.testing.assert_array_equal(record_ticks(simulator, self.ticks), plain)

    def test_varied_rows_are_single_robots(self) -> None:
        """A varied robot moves as it would alone, bit for bit."""
        friction = self.nominal_friction * np.array([1.0, 0.4, 1.8, 1.0])
        mass = np.array([1.0, 1.3, 0.7, 1.5])
        batch = self.make_simulator(4)
        vary_and_reset(batch, friction, mass)
        singles = [self.make_simulator(1) for _ in range(4)]
        for row, single in enumerate(singles):
            vary_and_reset(single, friction[row : row + 1], mass[row : row + 1])
        for tick in range(self.ticks):
            torque = stamping_torque(batch.robot, batch.state, tick)
            assert_same_rows(batch, singles)
            for row, single in enumerate(singles):
                single.step(torque[row : row + 1])
            batch.step(torque)

    def test_variation_holds_from_the_next_reset_on(self) -> None:
        """A variation takes effect at a robot's next reset, and lasts through every later one."""
        robot = self.make_simulator(1).robot
        q = np.tile(standing(robot), (2, 1))
        v = np.zeros((2, 18))
        friction = np.full(2, 0.6 * self.nominal_friction)
        mass = np.full(2, 1.5)
        plain = record_ticks(self.make_simulator(2), self.ticks)
        varied = self.make_simulator(2)
        vary_and_reset(varied, friction, mass)
        heavy = record_ticks(varied, self.ticks)
        differs = (plain[-1, :, :19] != heavy[-1, :, :19]).any(axis=1)
        assert differs.all(), "a variation has no effect"
        never_varied = self.make_simulator(2)
        simulator = self.make_simulator(2)
        simulator.vary(friction, mass)
        # `vary` reads its arguments and must not keep them.
        friction[:] = 0.9
        mass[:] = 0.9
        np.testing.assert_array_equal(record_ticks(simulator, self.ticks), plain, "not yet reset")
        simulator.reset(q, v, np.array([True, False]))
        record_ticks(never_varied, self.ticks)
        mixed = record_ticks(simulator, self.ticks)
        np.testing.assert_array_equal(mixed[:, 0], heavy[:, 0])
        np.testing.assert_array_equal(mixed[:, 1], record_ticks(never_varied, self.ticks)[:, 1])
        for _ in range(2):
            simulator.reset(q, v)
            np.testing.assert_array_equal(record_ticks(simulator, self.ticks), heavy)

    def test_unusable_variations_are_refused(self) -> None:
        """Anything but B finite positive numbers is a ValueError, and none of it takes effect."""
        plain = self.make_simulator(2)
        upright = np.tile(standing(plain.robot), (2, 1))
        expected = record_ticks(plain, 20)
        for friction, mass in (
            ([0.5, 0.5], [1.0, 0.0]),
            ([-0.1, 0.5], [1.0, 1.0]),
            ([0.5, np.nan], [1.0, 1.0]),
            ([0.3, 0.3], [np.inf, 1.0]),
            ([0.5], [1.0, 1.0]),
            ([0.3, 0.3], 1.0),
        ):
            simulator = self.make_simulator(2)
            try:
                simulator.vary(np.array(friction), np.array(mass))
            except ValueError:
                pass
            else:
                raise AssertionError(f"friction {friction} and mass {mass} are not refused")
            simulator.reset(upright, np.zeros((2, 18)))
            np.testing.assert_array_equal(record_ticks(simulator, 20), expected)

    def test_a_torque_that_is_nan_blows_up_its_robot_only(self) -> None:
        """The robot is reported at once and stands still; the others keep every bit."""
        assert_blows_up_alone(self.make_simulator(5), self.make_simulator(5), torque=np.nan)

    def test_a_start_that_is_nan_blows_up_its_robot_only(self) -> None:
        """The robot is reported at its reset and stands still; the others keep every bit."""
        assert_blows_up_alone(self.make_simulator(5), self.make_simulator(5), angle=np.nan)

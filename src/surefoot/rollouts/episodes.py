"""The input of a rollout, which is `Episodes` to run, and its output, a `Rollout`.

A rollout holds everything that was measured, commanded and decided, tick by tick;
`Rollout.recording` selects what a method keeps to learn from. Read `engine` next, which turns
episodes into a rollout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from surefoot.learning.frames import Frames
from surefoot.learning.layouts import LONGEST_HISTORY
from surefoot.rollouts.outcome import failed
from surefoot.rollouts.past import Past, join_pasts, with_past
from surefoot.scenarios.disturbance import Disturbance, join_disturbances
from surefoot.scenarios.gait_switches import GaitSwitches, gaits_by_tick, join_switches
from surefoot.scenarios.starts import Starts, join_starts
from surefoot.scenarios.starts_check import check_starts, checked_ids, with_whole_numbers
from surefoot.sim.terrain import Ground, join_grounds
from surefoot.types import Array, BoolArray, IntArray, State, lowered, to_ticks

Part = TypeVar("Part")
"""The type of a field of the parts that are joined."""


@dataclass(frozen=True)
class Episodes:
    """B episodes to run: where they begin, how long they last, and what disturbs the robots.

    Attributes:
        starts: The B initial states, each with its gait clock and command.
        duration: The duration T of the episode proper [s].
        tail: The time after T during which the expert drives robots that have not fallen [s].
        id: ``(B,)`` ids, which fix everything random; None numbers the episodes from 0.
        disturbance: What disturbs the B robots; None leaves them undisturbed.
        late: ``(B, delay, 12)`` the torques that are still delayed when the episodes begin, in the
            order in which they act [N m]; where one is NaN, the first torque of the episode acts
            instead. None if there are none at all. `Rollout.branch` fills this in.
        ground: The ground of the B robots, where heights are measured from the loaded feet; None is
            level ground, where they are measured from z = 0.
        switches: When robots change their gait, and to which one; None keeps the gait of each
            initial state.
        past: What happened to the robots before, which a policy with a history remembers; None if
            nothing did. `Rollout.branch` fills this in.

    Raises:
        ValueError: There is nothing to simulate, no robot can begin in one of the initial states
            (`check_starts`), or the ids, disturbance, late torques, ground, switches or past are
            for another number of robots than there are initial states.
    """

    starts: Starts
    duration: float
    tail: float = 0.0
    id: IntArray | None = None
    disturbance: Disturbance | None = None
    late: Array | None = None
    ground: Ground | None = None
    switches: GaitSwitches | None = None
    past: Past | None = None

    def __post_init__(self) -> None:
        """Check that the episodes can be simulated, and convert whole numbers to one type."""
        check_starts(self.starts)
        object.__setattr__(self, "starts", with_whole_numbers(self.starts))
        B = len(self.starts)
        lasts = math.isfinite(self.duration) and to_ticks(self.duration) >= 1
        if not lasts or not 0.0 <= self.tail < math.inf:
            raise ValueError(
                f"a rollout of {self.duration} s with a tail of {self.tail} s; use at least "
                "0.001 s, and a tail of 0 s or more"
            )
        if self.id is not None:
            object.__setattr__(self, "id", checked_ids(self.id, B))
        disturbed = None if self.disturbance is None else self.disturbance.batch
        if disturbed is not None and disturbed != B:
            raise ValueError(f"a disturbance of {disturbed} robots, but there are {B}")
        parts = {"the ground": self.ground, "switches": self.switches, "the past": self.past}
        for name, part in parts.items():
            if part is not None and len(part) != B:
                raise ValueError(f"{name} of {len(part)} robots, but there are {B}")
        if self.late is not None:
            delay = 0 if self.disturbance is None else self.disturbance.delay
            object.__setattr__(self, "late", np.asarray(self.late, dtype=np.float64))
            if np.shape(self.late) != (B, delay, 12):
                raise ValueError(
                    f"late torques {np.shape(self.late)} for {B} robots and a delay of {delay} ms; "
                    f"give ({B}, {delay}, 12)"
                )

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice | NDArray) -> Episodes:
        """Some of the episodes, with their ids and disturbances."""
        disturbance = None if self.disturbance is None else self.disturbance[rows]
        return replace(
            self,
            starts=self.starts[rows],
            id=self.ids[rows],
            disturbance=disturbance,
            late=None if self.late is None else self.late[rows],
            ground=None if self.ground is None else self.ground[rows],
            switches=None if self.switches is None else self.switches[rows],
            past=None if self.past is None else self.past[rows],
        )

    @property
    def ids(self) -> IntArray:
        """``(B,)`` the ids, 0 to B - 1 where none were given."""
        return np.arange(len(self.starts)) if self.id is None else self.id

    @property
    def several_gaits(self) -> bool:
        """Whether any robot is to walk a gait other than the first one at any time."""
        switched = self.switches is not None and self.switches.gait.any()
        return bool(switched or self.starts.gait.any())

    def gait_at(self, elapsed: int) -> IntArray:
        """``(B,)`` the number of the gait that each robot is to walk at a tick of its episode."""
        if self.switches is None:
            return self.starts.gait
        return self.switches.at(self.starts.gait, elapsed)

    def gaits_until(self, T: int) -> IntArray:
        """``(B, T)`` the number of the gait that each robot is to walk in the first T ticks."""
        return gaits_by_tick(self.starts.gait, self.switches, T)


def join_episodes(parts: Sequence[Episodes]) -> Episodes:
    """The episodes of one or more parts of the same duration, one part after another.

    Args:
        parts: The parts, with disturbances that are drawn from one configuration.

    Raises:
        ValueError: Some parts are disturbed, have late torques, ground or a past, and others do
            not.
    """
    grounds = _of_all([part.ground for part in parts], "have ground of their own; give all")
    disturbances = _of_all([part.disturbance for part in parts], "are disturbed; disturb all")
    lates = _of_all([part.late for part in parts], "have late torques; give all")
    switches = _of_all([part.switches for part in parts], "change their gait; give all")
    pasts = _of_all([part.past for part in parts], "have a past; give all")
    return replace(
        parts[0],
        starts=join_starts([part.starts for part in parts]),
        id=np.concatenate([part.ids for part in parts]),
        disturbance=join_disturbances(disturbances) if disturbances else None,
        late=np.concatenate(lates) if lates else None,
        ground=join_grounds(grounds) if grounds else None,
        switches=join_switches(switches) if switches else None,
        past=join_pasts(pasts) if pasts else None,
    )


def _of_all(values: Sequence[Part | None], what: str) -> list[Part]:
    """The values of all parts, or an empty list if no part has one.

    Raises:
        ValueError: Some parts have one, and others do not.
    """
    given = [value for value in values if value is not None]
    if len(given) not in (0, len(values)):
        raise ValueError(f"{len(given)} of {len(values)} parts {what}")
    return given


@dataclass(frozen=True)
class Rollout:
    """B episodes of at most T ticks, tail included. Ticks from ``length[b]`` on are undefined.

    Attributes:
        q: ``(B, T, 19)`` configuration [m, unit quaternion, rad].
        v: ``(B, T, 18)`` velocity [m/s, rad/s].
        com: ``(B, T, 3)`` center of mass [m].
        feet: ``(B, T, 4, 3)`` foot positions [m].
        contacts: ``(B, T, 4)`` foot contacts.
        seen: The states ``(B, T, ...)`` as the robots measured them, with heights above their
            ground if they have one; the same arrays as above without noise on level ground.
        torque: ``(B, T, 12)`` torque commanded by the driver [N m], clipped to the motor limit.
        expert_torque: ``(B, T, 12)`` torque of the expert where it was asked [N m]; the same array
            as ``torque`` if the expert was asked only where it drove.
        expert_drove: ``(B, T)`` True where the expert drove.
        expert_asked: ``(B, T)`` True where the expert was asked and had not given up on the robot.
        body_contact: ``(B, T)`` True where something other than a foot touched the ground.
        starts: The B initial states.
        length: ``(B,)`` number of ticks simulated.
        outcome: ``(B,)`` values of `Outcome`.
        duration: Number of ticks of the episode proper; the rest of the T ticks are the tail.
        disturbance: What disturbed the robots.
        late: ``(B, delay, 12)`` the torques that were still delayed at the beginning, as in
            `Episodes`; None if there were none.
        ground: The ground of the robots; None is level ground at z = 0.
        switches: When the robots changed their gait; None if none did.
        felt_ground: ``(B, T)`` the height of the ground as the robots' feet felt it, without noise,
            world frame [m]; None on level ground.
        past: What happened to the robots before; None if nothing did.
    """

    q: Array
    v: Array
    com: Array
    feet: Array
    contacts: BoolArray
    seen: State
    torque: Array
    expert_torque: Array
    expert_drove: BoolArray
    expert_asked: BoolArray
    body_contact: BoolArray
    starts: Starts
    length: IntArray
    outcome: IntArray
    duration: int
    disturbance: Disturbance = field(default_factory=Disturbance)
    late: Array | None = None
    ground: Ground | None = None
    switches: GaitSwitches | None = None
    felt_ground: Array | None = None
    past: Past | None = None

    @property
    def gait(self) -> IntArray:
        """``(B, T)`` the number of the gait that each robot was to walk at each tick."""
        return gaits_by_tick(self.starts.gait, self.switches, self.q.shape[1])

    @property
    def felt(self) -> State:
        """The states ``(B, T, ...)`` without noise, with heights above the ground of the robots.

        The expert and the arbiter saw these states if they were privileged.
        """
        truth = State(self.q, self.v, self.com, self.feet, self.contacts)
        return truth if self.felt_ground is None else lowered(truth, self.felt_ground)

    @property
    def failed(self) -> BoolArray:
        """``(B,)`` True for robots that fell, or that the expert gave up on."""
        return failed(self.outcome)

    @property
    def happened(self) -> BoolArray:
        """``(B, T)`` True for ticks that were simulated."""
        return np.arange(self.q.shape[1]) < self.length[:, None]

    def branch(self, robot: IntArray, elapsed: IntArray, duration: float, id: IntArray) -> Episodes:
        """Episodes that continue from states of this rollout, under the same conditions.

        Each robot keeps its friction, its mass, its delayed torques, its noise from that tick on,
        and the pushes and gait changes that are still to come. Driven by the same torques, it moves
        as it did here, up to the rounding of the simulator's reset (1e-13 after 150 ticks of a
        steady trot, 1e-6 where feet slip). A policy remembers what came before, whoever drove.
        Experts and arbiters start afresh, and so does the time for which a body has touched the
        ground. An expert continues as before if it planned at this tick, as it does on its grid.

        Args:
            robot: ``(n,)`` rows of the robots; a row may come several times.
            elapsed: ``(n,)`` the tick of the rollout from which each robot continues [ms].
            duration: The time that the episodes last [s].
            id: ``(n,)`` ids of the episodes.

        Raises:
            ValueError: The episode of a robot had ended by its tick.
        """
        over = elapsed >= self.length[robot]
        if over.any():
            row = int(over.argmax())
            raise ValueError(
                f"robot {robot[row]} cannot go on from tick {elapsed[row]}: its episode lasted "
                f"{self.length[robot[row]]} ticks, and the state of the last is not recorded"
            )
        starts = Starts(
            self.q[robot, elapsed],
            self.v[robot, elapsed],
            self.starts.tick[robot] + elapsed,
            self.starts.command[robot],
            self.starts.id[robot],
            self.gait[robot, elapsed],
        )
        disturbance = self.disturbance[robot].after(elapsed)
        return Episodes(
            starts,
            duration,
            id=id,
            disturbance=disturbance,
            late=self._under_way(robot, elapsed),
            ground=self._ground_from(robot, elapsed),
            switches=None if self.switches is None else self.switches[robot].after(elapsed),
            past=self._past_of(robot, elapsed),
        )

    def _past_of(self, robot: IntArray, elapsed: IntArray) -> Past:
        """The past of robots at a tick of this rollout, including what came before the rollout."""
        tick = elapsed[:, None] + np.arange(-LONGEST_HISTORY, 0)
        here = tick >= 0
        # If nothing came before the rollout, its first tick stands for the ticks before it.
        at = (robot[:, None], np.maximum(tick, 0))
        past = Past(
            elapsed=elapsed,
            seen=self.seen[at],
            torque=np.where(here[..., None], self.torque[at], np.nan),
            expert_drove=self.expert_drove[at] & here,
            gait=self.gait[at],
        )
        if self.past is None:
            return past
        return past.after(self.past[robot])

    def _ground_from(self, robot: IntArray, elapsed: IntArray) -> Ground | None:
        """The ground of robots that continue from a tick, with what their feet felt there."""
        if self.ground is None:
            return None
        if self.felt_ground is None:
            raise ValueError("a rollout on a ground needs felt_ground, what the feet felt of it")
        felt = self.felt_ground[robot, elapsed]
        return replace(self.ground[robot], felt=felt, touching=self.contacts[robot, elapsed])

    def _under_way(self, robot: IntArray, elapsed: IntArray) -> Array | None:
        """``(n, delay, 12)`` torques that were commanded before a tick and have not acted yet."""
        delay = self.disturbance.delay
        if delay == 0:
            return None
        before = np.full((len(self.length), delay, 12), np.nan) if self.late is None else self.late
        line = np.empty((len(robot), delay, 12))
        for row, (b, tick) in enumerate(zip(robot.tolist(), elapsed.tolist(), strict=True)):
            # Where no torque was delayed at the beginning, the first torque acts in its place.
            first = self.torque[b, 0] if tick > 0 else np.nan
            began_with = np.where(np.isnan(before[b]), first, before[b])
            commanded = self.torque[b, max(tick - delay, 0) : tick]
            line[row] = np.concatenate([began_with, commanded])[-delay:]
        return line

    def frames(self, keep: BoolArray, episode: IntArray) -> Frames:
        """The frames to keep, episode by episode; the arguments are those of `recording`."""
        return self.recording(keep, episode).kept_frames

    def recording(self, keep: BoolArray, episode: IntArray) -> Frames:
        """The frames to keep and the ticks that policies remember there, episode by episode.

        Policies remember the last `LONGEST_HISTORY` ticks before each kept frame, whoever drove. In
        episodes that continue from others, these include ticks of the others.

        Args:
            keep: ``(B, T)`` True for the frames to keep; ticks that did not happen are left out.
            episode: ``(B,)`` ids, unique in the dataset.

        Raises:
            ValueError: The expert was not asked about a frame to keep, the mask does not fit, or
                two episodes have the same id.
        """
        if np.shape(episode) != self.length.shape or np.shape(keep) != self.expert_asked.shape:
            raise ValueError(
                f"frames: keep is {np.shape(keep)} and episode {np.shape(episode)}, expected "
                f"{self.expert_asked.shape} and {self.length.shape}"
            )
        ids, counts = np.unique(episode, return_counts=True)
        if (counts > 1).any():
            raise ValueError(
                f"frames: {counts.max()} episodes have the id {ids[counts.argmax()]}; give each an "
                "id of its own, or a dataset takes them for one"
            )
        keep = keep & self.happened
        if (keep & ~self.expert_asked).any():
            raise ValueError(
                "the expert was not asked about some of the frames to keep: keep frames of "
                "expert_asked only, or ask it at every tick (rollout(..., ask_always=True))"
            )
        # Whether a frame is kept at a tick or soon after it: a difference of running counts.
        T = keep.shape[1]
        count = np.zeros((len(keep), T + 1), dtype=np.int64)
        np.cumsum(keep, axis=1, out=count[:, 1:])
        recorded = count[:, np.minimum(np.arange(T) + LONGEST_HISTORY + 1, T)] > count[:, :T]
        robot, elapsed = np.nonzero(recorded)
        seen = self.seen[recorded]
        frames = Frames(
            q=seen.q,
            v=seen.v,
            com=seen.com,
            feet=seen.feet,
            contacts=seen.contacts,
            tick=self.starts.tick[robot] + elapsed,
            command=self.starts.command[robot],
            torque=self.expert_torque[recorded],
            expert_drove=self.expert_drove[recorded],
            episode=episode[robot],
            outcome=self.outcome[robot].astype(np.int8),
            gait=self.gait[recorded].astype(np.int8),
            kept=keep[recorded],
            applied=self.torque[recorded],
            elapsed=elapsed.astype(np.int32),
        )
        return frames if self.past is None else with_past(frames, robot, self.past)

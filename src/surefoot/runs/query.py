"""LocoDAGGER's data collection (paper, Algorithm 3): the expert drives from visited states.

for j = 1 .. N_query:
    s_0 <- a random state of the rollout
    the expert drives from s_0 for T_query, D <- D u {its frames}

`methods.loco_dagger` gives a `Query` to its job, which calls it with the rollouts of each chunk.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job, disturbance_of
from surefoot.runs.episode_ids import EpisodeId
from surefoot.runs.sampling import keep_unless_failed
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.seeds import seed_of
from surefoot.types import GRID, IntArray, to_ticks


@dataclass(frozen=True)
class Query:
    """Expert rollouts from random states of each rollout, which keep the gait phase of the state.

    No state of a rollout is chosen twice; if fewer than N_query states are on the expert's grid,
    there is a query from each of them. A query is the same robot on the same ground: it keeps
    friction, mass, sensor noise and delayed torques (`Rollout.branch`), and also what a policy with
    a history remembers. It does not keep the pushes of the rollout; instead it has an early push of
    `expert_impulse`, if that is not zero.

    Attributes:
        N_query: Largest number of queries of each rollout.
        T_query: Duration of each query [s]; a query that fails is dropped whole.
        before_fall: Time before a failure in which no state is chosen [s].
    """

    N_query: int
    T_query: float
    before_fall: float

    def __call__(self, job: Job, rollouts: Rollout) -> Job | None:
        """The queries of these rollouts as a job; None if no rollout lasted long enough.

        Args:
            job: The job whose rollouts have been run.
            rollouts: Its B rollouts.
        """
        robots: list[int] = []
        elapsed_ticks: list[int] = []
        ids: list[int] = []
        for robot, episode in enumerate(job.episode.tolist()):
            chosen = self._chosen_ticks(job, rollouts, robot)
            for j, elapsed in enumerate(chosen.tolist()):
                robots.append(robot)
                elapsed_ticks.append(elapsed)
                ids.append(replace(EpisodeId.from_number(episode), query=j).number)
        if not ids:
            return None
        # Friction, mass, noise and delayed torques are kept, but not the pushes of the rollout.
        branches = rollouts.branch(
            np.array(robots), np.array(elapsed_ticks), self.T_query, np.array(ids)
        )
        queries = replace(
            job,
            episodes=_at_the_origin(branches),
            arbiter=ExpertOnly(),
            policy=None,
            keep=keep_unless_failed,
            disturbance=replace(job.disturbance, pushes=0),
            query=True,
            then=None,
        )
        return _with_own_pushes(queries)

    def _chosen_ticks(self, job: Job, rollouts: Rollout, robot: int) -> IntArray:
        """Ticks of a rollout that its queries start from, on the expert's grid and in order."""
        length = int(rollouts.length[robot])
        if rollouts.failed[robot]:
            length -= to_ticks(self.before_fall)
        clock = int(rollouts.starts.tick[robot]) + np.arange(max(length, 0))
        grid = np.flatnonzero(clock % GRID == 0)
        rng = np.random.default_rng(seed_of(job.config.seed, "query", int(job.episode[robot])))
        # Without replacement: a second query from the same state would repeat the first.
        return np.sort(rng.choice(grid, min(self.N_query, len(grid)), replace=False))


def _at_the_origin(episodes: Episodes) -> Episodes:
    """Episodes moved to begin at x = y = 0, as initial states do, together with their ground."""
    q = episodes.starts.q.copy()
    place = q[:, :2].copy()
    q[:, :2] = 0.0
    ground = None if episodes.ground is None else episodes.ground.moved(-place)
    past = None if episodes.past is None else episodes.past.moved(-place)
    return replace(episodes, starts=replace(episodes.starts, q=q), ground=ground, past=past)


def _with_own_pushes(queries: Job) -> Job:
    """Queries with pushes drawn from their own ids, and otherwise as disturbed as the rollouts."""
    inherited = queries.episodes.disturbance or Disturbance()
    undisturbed = replace(queries.episodes, disturbance=None, late=None)
    pushes = disturbance_of(replace(queries, episodes=undisturbed)).pushes
    disturbance = replace(inherited, pushes=pushes)
    return replace(queries, episodes=replace(queries.episodes, disturbance=disturbance))

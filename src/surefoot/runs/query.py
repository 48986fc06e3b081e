"""LocoDAGGER's data collection (paper, Algorithm 3): the expert drives from states seen before.

for j = 1 .. N_query:
    s_0 <- a random state of the rollout
    the expert drives from s_0 for T_query, D <- D u {its frames}

`methods.loco_dagger` hands a `Query` to its job, which calls it with the rollouts of each chunk.
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
    """Expert rollouts from random states of each rollout, at the gait phase they were seen at.

    The states of a rollout are different ones; if it has fewer than N_query on the expert's grid,
    there is a query from each of them. A query is the same robot on the same floor: friction, mass,
    sensor noise and the torques under way go on (`Rollout.branch`), and so does what a policy with
    a history remembers. The pushes of the rollout do not; a push of the size of `expert_impulse`
    comes early, if that is not zero.

    Attributes:
        N_query: Number of queries of each rollout, at most.
        T_query: Duration of each query [s]; a query that fails is dropped whole.
        before_fall: Time before a failure from which on no state is taken [s].
    """

    N_query: int
    T_query: float
    before_fall: float

    def __call__(self, job: Job, rollouts: Rollout) -> Job | None:
        """The expert's rollouts from states of these; None if no rollout lasted long enough.

        Args:
            job: The job that was played out.
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
        # Friction, mass, noise and late torques go on; the pushes of the rollout do not.
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
        # Without replacement: a second query from one state would be the first once more.
        return np.sort(rng.choice(grid, min(self.N_query, len(grid)), replace=False))


def _at_the_origin(episodes: Episodes) -> Episodes:
    """Episodes that begin at x = y = 0, as initial states do, on the ground that they were on."""
    q = episodes.starts.q.copy()
    place = q[:, :2].copy()
    q[:, :2] = 0.0
    ground = None if episodes.ground is None else episodes.ground.moved(-place)
    past = None if episodes.past is None else episodes.past.moved(-place)
    return replace(episodes, starts=replace(episodes.starts, q=q), ground=ground, past=past)


def _with_own_pushes(queries: Job) -> Job:
    """Queries with pushes drawn from their own ids, and all else as it was in their rollouts."""
    inherited = queries.episodes.disturbance or Disturbance()
    undisturbed = replace(queries.episodes, disturbance=None, late=None)
    pushes = disturbance_of(replace(queries, episodes=undisturbed)).pushes
    disturbance = replace(inherited, pushes=pushes)
    return replace(queries, episodes=replace(queries.episodes, disturbance=disturbance))

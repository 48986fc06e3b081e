"""LocoDAGGER's data collection (paper, Algorithm 3): the expert drives from states seen before."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import Episodes, Rollout
from surefoot.rollouts.jobs import Job
from surefoot.runs.sampling import EPISODES_PER_ITERATION, keep_unless_failed
from surefoot.scenarios.starts import Starts
from surefoot.seeds import seed_of
from surefoot.types import GRID, to_ticks

QUERIES = 10_000
"""Ids of an iteration from this on are the expert's rollouts: this + rollout * N_query + j."""


@dataclass(frozen=True)
class Query:
    """Expert rollouts from random states of each rollout, at the gait phase they were seen at.

    The rollout's pushes do not go on; one of `expert_impulse` comes early, if there shall be one.

    Attributes:
        N_query: of each rollout.
        T_query: [s] of each; one that fails is dropped whole.
        before_fall: [s] states are taken at the latest so long before a failure.
    """

    N_query: int
    T_query: float
    before_fall: float

    def parent(self, episode: int) -> int:
        """The id of the rollout that a query starts from; any other id is its own parent."""
        iteration, index = divmod(episode, EPISODES_PER_ITERATION)
        if index < QUERIES:
            return episode
        return iteration * EPISODES_PER_ITERATION + (index - QUERIES) // self.N_query

    def __call__(self, job: Job, record: Rollout) -> Job | None:
        """The expert's rollouts; None if no rollout lasted long enough."""
        rows, ids = [], []
        for robot, episode in enumerate(job.episode.tolist()):
            length = int(record.length[robot])
            if record.failed[robot]:
                length -= to_ticks(self.before_fall)
            clock = int(record.starts.tick[robot]) + np.arange(max(length, 0))
            grid = np.flatnonzero(clock % GRID == 0)
            rng = np.random.default_rng(seed_of(job.config.seed, "query", episode))
            chosen = rng.choice(grid, self.N_query) if len(grid) else grid
            rows += [(robot, elapsed) for elapsed in np.sort(chosen).tolist()]
            first = episode + QUERIES + (episode % QUERIES) * (self.N_query - 1)
            ids += range(first, first + len(chosen))
        if not rows:
            return None
        robot, elapsed = np.array(rows).T
        q = record.q[robot, elapsed].copy()
        q[:, :2] = 0.0
        starts = Starts(
            q,
            record.v[robot, elapsed],
            record.starts.tick[robot] + elapsed,
            record.starts.command[robot],
            record.starts.id[robot],
        )
        return replace(
            job,
            episodes=Episodes(starts, self.T_query, id=np.array(ids)),
            arbiter=ExpertOnly(),
            policy=None,
            keep=keep_unless_failed,
            disturbance=replace(job.disturbance, pushes=0),
            query=True,
            then=None,
        )

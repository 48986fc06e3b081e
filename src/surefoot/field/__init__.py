"""Learning on a robot behind a bridge: episodes in the place of simulated rollouts.

The runtime of `surefoot.deploy` drives, the method's own arbiter says where the expert takes over,
and what was recorded enters the run's dataset as simulated frames do. The expert plans in a process
of its own (`planner`), also for `surefoot run --gate expert`. It is the only room that knows both
`deploy` and `runs`. Read `collection` next, then `session` and `episode`.
"""

"""Learning on a robot behind a bridge: episodes on the robot replace simulated rollouts.

The runtime of `surefoot.deploy` drives the robot, the method's arbiter decides when the expert
takes over, and the recorded frames enter the run's dataset like simulated ones. The expert plans in
a separate process (`planner`), also for `surefoot run --gate expert`. Except for `cli`, `bench` and
`viz`, only this package imports both `deploy` and `runs`. Read `collection` next, then `session`
and `episode`.
"""

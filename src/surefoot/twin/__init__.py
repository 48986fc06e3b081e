"""A simulated twin: MuJoCo behind the bridge of `surefoot.deploy`, in a separate process.

It is driven exactly like the robot, with noise, delay, loss, jitter and a payload if wanted. Read
`driver` next, then `serve`.
"""

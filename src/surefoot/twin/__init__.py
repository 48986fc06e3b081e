"""A simulated twin: MuJoCo behind the bridge of `surefoot.deploy`, in a process of its own.

It is driven as the robot would be, with noise, delay, loss, jitter and a payload where wanted. Read
`driver` next, then `serve`.
"""

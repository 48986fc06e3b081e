"""Robots: their models, shapes and rigid-body motion.

`model` is what the package needs to know about a robot; the robots themselves are rows of
`config.robot_table`. Nothing is imported here, so importing one module does not load the others.
Read `robots.model` next.
"""

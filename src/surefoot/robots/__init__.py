"""Robots: their models, shapes and rigid-body motion.

`model` says what the package needs to know of a robot, and each robot has a file of its own.
Nothing is imported here, so importing one module does not load the others. Read `robots.model`
next.
"""

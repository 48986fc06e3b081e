"""A kill from outside, for tests of what a kill leaves behind."""


class Killed(BaseException):
    """Nothing in the package may catch this."""

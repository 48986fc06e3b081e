"""What tests of the contracts share: which of a contract's tests a subject fails."""


def failing(contract) -> set[str]:
    """Names of the contract's tests that the subject of this contract fails."""
    names = [name for name in dir(contract) if name.startswith("test_")]
    assert names
    failed = set()
    for name in names:
        try:
            getattr(contract, name)()
        except AssertionError:
            failed.add(name)
    return failed

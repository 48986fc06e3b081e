"""Random damage to every file that the package reads; longer with SUREFOOT_FUZZ_SECONDS=600."""
